"""Right of way at junctions."""
