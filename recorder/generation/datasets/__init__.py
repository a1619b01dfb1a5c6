"""Datasets of several drives: plan, clock, manifest, the sequences of all towns."""
