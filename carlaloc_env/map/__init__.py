"""The map of a town: OpenDRIVE, lanes, routes and checks, without anything that is only seen."""
