"""Which sensors a car carries."""
