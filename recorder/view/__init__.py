"""Drives, sequences and towns as recordings of rerun, to look at in its viewer."""
