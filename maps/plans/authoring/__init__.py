"""Plans of towns: nodes, roads, ramps and roundabouts, turned into OpenDRIVE."""
