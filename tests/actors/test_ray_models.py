"""LiDAR rays against the depth picture: both must meet the same actors, steered, striding, near and far."""

import numpy as np
import pytest
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import need_opengl
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.actors.articulation import LOW_FROM_M
from carlaloc_env.actors.instances import place_actors
from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.assets.model_library import build_library
from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline

pytest.importorskip("open3d", reason="Open3D casts the rays")
need_opengl()

EYE_M = np.array([0.0, 0.0, 1.6])
CAMERA = Pinhole(width_px=640, height_px=180, fx_px=320.0, fy_px=320.0, cx_px=320.0, cy_px=90.0)


def actors() -> tuple[ActorCatalog, ActorFrame]:
    """Every vehicle once near and once far, and walkers in mid-stride, beside each other ahead."""
    names = (*VEHICLES, *VEHICLES, *WALKERS)
    count, vehicles = len(names), len(VEHICLES)
    bearing = np.radians(np.linspace(-40.0, 40.0, vehicles))
    near, far = np.full(vehicles, 24.0), np.full(vehicles, LOW_FROM_M + 25.0)
    walk = np.radians(np.linspace(-38.0, 38.0, len(WALKERS)))
    distance = np.concatenate([near, far, np.full(len(WALKERS), 9.0)])
    bearing = np.concatenate([bearing, bearing + 0.03, walk])
    place = np.stack([distance * np.cos(bearing), distance * np.sin(bearing), np.zeros(count)], axis=1)
    tags = [VEHICLES[n].tag if n in VEHICLES else Tag.PEDESTRIAN for n in names]
    frame = Scenery.frame(
        place,
        heading_rad=np.linspace(-2.0, 2.5, count),
        pitch_rad=np.linspace(-0.05, 0.05, count),
        speed_mps=1.3,
        travelled_m=np.linspace(0.0, 9.0, count),
        steer_rad=np.linspace(-0.6, 0.6, count),
    )
    return Scenery.catalog(names, tags), frame


def test_rays_meet_the_shapes_that_cameras_see() -> None:
    """At pixel centres on actors, the ray's hit is the picture's actor, and as far away within 3 cm."""
    from carlaloc_env.raycast import RayScene

    ground = Scenery.ground()
    library, (catalog, frame) = build_library(), actors()
    T = transforms.from_rotation(transforms.R_FLU_OPTICAL, EYE_M)
    # Quality "low" is for live pictures: it draws far cars in few triangles.
    with SceneRenderer([ground], library, quality="medium", albedo=plain_albedo()) as renderer:
        picture = renderer.draw(CAMERA, T, place_actors(catalog, frame, library, eye_m=EYE_M))
        depth, (_, instance) = picture.depth_m(), picture.labels()
    v, u = np.nonzero(instance > EGO_INSTANCE)
    local = np.stack(
        [(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(len(u))], axis=-1
    )
    length = np.linalg.norm(local, axis=1)
    standing = EgoTrack.from_arrays(np.zeros((12, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (12, 1)))
    timeline = Timeline(catalog, ego=standing)
    for _ in range(2):
        timeline.append_step(frame, np.zeros(0, np.uint8))
    hits = RayScene([ground], library).cast(
        np.tile(EYE_M, (len(u), 1)),
        local / length[:, None] @ T[:3, :3].T,
        np.zeros(len(u), np.int64),
        timeline,
        200.0,
        ego=False,
    )
    same = hits.instance == instance[v, u]
    assert same.mean() > 0.99
    gap = np.abs(hits.range_m[same] / length[same] - depth[v, u][same])
    assert np.mean(gap < 0.03) > 0.985
    seen = np.unique(instance[v, u][same])
    assert len(seen) > 0.7 * len(catalog)
    for actor in seen:
        own = gap[instance[v, u][same] == actor]
        assert np.median(own) < 0.01
