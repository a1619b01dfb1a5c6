"""Falling rain."""
