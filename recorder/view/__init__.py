"""Drives, sequences and towns as recordings of rerun, and as pages for browsers."""
