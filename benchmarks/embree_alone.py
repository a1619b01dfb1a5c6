"""Time of Embree alone for a LiDAR's rays: town and actors as one scene that does not move."""

from collections.abc import Callable

import numpy as np
import open3d
from numpy.typing import NDArray

from carlaloc_env.actors.instances import place_actors
from carlaloc_env.scene.mesh import Mesh, ModelLibrary, merge
from carlaloc_env.timeline.timeline import Timeline


def embree_alone(
    chunks: tuple[Mesh, ...],
    library: ModelLibrary,
    timeline: Timeline,
    stamp_ns: int,
) -> Callable[[NDArray[np.float32]], object]:
    """A call that casts rays against everything where it stands at one instant.

    The rays are origins [m] and directions, world, shape (N, 6).

    Args:
        chunks: Meshes of the town.
        library: Models of the actors.
        timeline: Where the actors are.
        stamp_ns: The instant [ns].
    """
    placed = place_actors(timeline.catalog, timeline.actors_at(stamp_ns), library)
    actors = [
        library.meshes[m].transformed(T) for m, T in zip(placed.model, placed.T_world_model, strict=True)
    ]
    whole = merge([*chunks, *actors])
    tensor = open3d.core.Tensor.from_numpy
    scene = open3d.t.geometry.RaycastingScene()
    triangles = np.ascontiguousarray(whole.triangles, dtype=np.uint32)
    scene.add_triangles(tensor(np.ascontiguousarray(whole.vertices_m, dtype=np.float32)), tensor(triangles))
    return lambda rays: scene.cast_rays(tensor(rays))
