"""From an OpenDRIVE file to a town: lanes, meshes, scenery."""
