"""CarlaLoc: a driving world, a SLAM sensor suite and a dataset factory."""

__version__ = "0.1.0"
