"""Who drives first at junctions."""
