"""Triangles to G-buffer: culling, drawing and labels."""
