"""The surface of a road: its profile, its roughness, what lies in it."""
