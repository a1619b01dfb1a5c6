"""Tools that turn areas and copies of props into meshes."""
