"""Procedural vehicles, walkers and street furniture: geometry, material and semantic tag."""
