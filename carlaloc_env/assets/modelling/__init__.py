"""Tools for making models: primitives, normals, decals."""
