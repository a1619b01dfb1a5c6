"""The file of a drive."""
