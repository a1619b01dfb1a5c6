"""Recorded drives as environments, step by step."""
