"""What is true: the ego's state, all objects and their visibility."""
