"""Models of plants."""
