"""Meshes of everything that stands in a town, built from its map."""
