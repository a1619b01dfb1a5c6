"""Buildings: lots, walls, façades, roofs."""
