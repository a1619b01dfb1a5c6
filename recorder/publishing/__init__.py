"""A dataset made ready for a hub."""
