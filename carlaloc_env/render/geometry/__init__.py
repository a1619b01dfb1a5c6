"""Triangles to G-buffer: what is drawn, culled and labelled."""
