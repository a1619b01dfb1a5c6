"""Movable models, made once, and measures of meshes that only tests need."""

import numpy as np
import pytest

from carlaloc_env.assets.model_library import build_library
from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, ModelLibrary


def signed_volume_m3(mesh: Mesh) -> float:
    """Volume inside a closed mesh [m³] by the divergence theorem, negative when it is inside out."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    return float(np.sum(a * cross(b, c)) / 6.0)


def model(library: ModelLibrary, name: str) -> Mesh:
    """A model by name."""
    return library.meshes[library.index(name)]


def facing_away(mesh: Mesh, rays: int = 4000) -> float:
    """Share of rays from all round that first meet a triangle from behind; leaves are open and left out."""
    o3d = pytest.importorskip("open3d", reason="Open3D casts the rays")
    solid = mesh.triangles[mesh.material[mesh.triangles[:, 0]] != Material.LEAF]
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices_m), o3d.core.Tensor(solid))
    rng = np.random.default_rng(1)
    low, high = mesh.bounds_m
    target = rng.uniform(low, high, (rays, 3))
    out = rng.normal(size=(rays, 3))
    out[:, 2] = np.abs(out[:, 2]) * 0.5
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    reach = 2.0 * float(np.linalg.norm(high - low))
    hits = scene.cast_rays(
        o3d.core.Tensor(np.concatenate([target + reach * out, -out], axis=1).astype(np.float32))
    )
    met = np.isfinite(hits["t_hit"].numpy())
    normal = hits["primitive_normals"].numpy()[met]
    assert met.sum() > rays / 20
    return float(np.mean(np.sum(normal * out[met], axis=1) < -1e-3))


@pytest.fixture(scope="session")
def library() -> ModelLibrary:
    """All movable models."""
    return build_library()
