"""Rays against the town and everything that moves in it: the only package that imports open3d."""

from carlaloc_env.raycast.culling import Cylinders, candidates
from carlaloc_env.raycast.hits import Hits
from carlaloc_env.raycast.scene import RayScene, into_actor_frame

__all__ = ["Cylinders", "Hits", "RayScene", "candidates", "into_actor_frame"]
