"""Measures of meshes that only tests need."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.mesh import Mesh


def signed_volume_m3(mesh: Mesh) -> float:
    """Volume inside a closed mesh [m³] by the divergence theorem, negative when it is inside out."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    return float(np.sum(a * cross(b, c)) / 6.0)
