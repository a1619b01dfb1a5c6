"""Parts of maps: cross sections, junctions, ramps, roundabouts."""
