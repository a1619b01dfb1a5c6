"""The plans of the towns, one module each."""
