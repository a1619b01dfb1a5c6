"""What is wrong with a map, by element and line."""
