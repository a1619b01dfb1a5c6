"""Kinds of sensors that the package does not have, in one file each."""
