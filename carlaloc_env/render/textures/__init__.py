"""Procedural textures: one linear-light layer per material, built by code and cached."""
