"""Frames, transforms, cameras, lenses and the globe."""
