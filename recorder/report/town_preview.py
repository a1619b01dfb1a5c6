"""A sheet about a town: from above with lanes, route, spawn points and lights, and four street views."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np

from carlaloc_env.actors.instances import place_actors
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.render.views import FAR_M
from carlaloc_env.scene.mesh import Instances, ModelLibrary
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.standing_traffic import TrafficTables, standing_traffic
from carlaloc_env.weather.presets import weather_by_name
from recorder.report.town_map import STRIP_PX, MapView, draw_map

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
"""What pictures of towns may be called."""
STREET_VIEWS = 4
MAP_PX = (1360, 1080 - STRIP_PX)
"""Width and height of the view from above [px]."""
STREET_PX = (480, 270)
"""Width and height of a street view [px]."""
_MAP_FOVS_DEG = (42.0, 52.0, 64.0, 80.0, 100.0)
_EYE_M = 1.6
_VEHICLES = 220
_SHRINK = 20.0
"""How much smaller the town is drawn from above: its depths resolve 0.4 m at 1 km."""
_CLEAR_M = 14.0
"""No vehicle stands nearer before a street view's eye [m]."""


def draw_town(town: Town, out: Path, *, quality: str = "medium", overwrite: bool = False) -> Path:
    """Write a town's sheet.

    Args:
        town: The town.
        out: PNG or JPEG to write.
        quality: Render quality.
        overwrite: Whether an older picture is replaced.

    Raises:
        RenderError: OpenGL is missing.
        OutputError: the image exists, or its name is not that of an image.
        WriterError: it cannot be written.
    """
    check_output_file(out, suffixes=PICTURE_SUFFIXES, overwrite=overwrite)
    sheet = cv2.cvtColor(town_sheet(town, quality=quality), cv2.COLOR_RGB2BGR)
    with atomic_write(out, WriterError) as part:
        part.write_bytes(cv2.imencode(out.suffix, sheet)[1].tobytes())
    return out


def town_sheet(town: Town, *, quality: str = "medium") -> U8:
    """View from above with its legend, and four street views beside it, sRGB, shape (1080, 1840, 3).

    Args:
        town: The town.
        quality: Render quality.

    Raises:
        RenderError: OpenGL is missing.
    """
    view = _from_above(town)
    plan = draw_map(town, view, _seen_from_above(town, view, quality), _spawn_points(town))
    stage = SensorStage(town, seed=0, weather=weather_by_name("ClearNoon"), quality=quality)
    try:
        renderer = stage.renderer()
        catalog, frame = standing_traffic(town.network, _VEHICLES)
        streets = []
        for k, T in enumerate(street_poses(town, STREET_VIEWS)):
            image = _street(stage, renderer, T, catalog, frame)
            streets.append(_labelled(image, f"{chr(ord('A') + k)}"))
            _mark(plan, view, T, chr(ord("A") + k))
    finally:
        stage.close()
    return np.hstack([plan, np.vstack(streets)])


def street_poses(town: Town, count: int) -> list[Array]:
    """Poses (4, 4) of a driver's eye, optical frame, spread along the route or over the lanes."""
    if town.route is not None:
        s = (np.arange(count) + 0.35) / count * town.route.length_m
        at = town.route.at(s)
        positions, headings = at.position_m, at.heading_rad
    else:
        lanes, stations = TrafficTables(town.network).starting_positions(0, np.zeros((0, 3)))
        pose = town.network.pose(lanes[:count], stations[:count])
        positions, headings = pose.position_m, pose.heading_rad
    poses = []
    for position, heading in zip(positions, headings, strict=True):
        c, s_ = np.cos(heading), np.sin(heading)
        R_world_flu = np.array([[c, -s_, 0.0], [s_, c, 0.0], [0.0, 0.0, 1.0]])
        poses.append(from_rotation(R_world_flu @ R_FLU_OPTICAL, position + np.array([0.0, 0.0, _EYE_M])))
    return poses


def _from_above(town: Town) -> MapView:
    """Camera straight above the town that sees all its roads, north up."""
    tables = town.network.tables
    low, high = tables.position_m.min(axis=0), tables.position_m.max(axis=0)
    centre, ground = 0.5 * (low + high), float(np.median(tables.position_m[:, 2]))
    half = 0.5 * (high - low)[:2] + 18.0
    width, height = MAP_PX
    # From as high as the renderer draws: the higher, the less houses lean outwards.
    for fov_deg in _MAP_FOVS_DEG:
        camera = Pinhole.from_fov(width, height, fov_deg)
        distance = 2.0 * max(half[0] * camera.fx_px / width, half[1] * camera.fy_px / height)
        corner = np.array([0.5 * width / camera.fx_px, 0.5 * height / camera.fy_px, 1.0]) * distance
        if float(np.sqrt(np.sum(corner**2))) < 0.95 * FAR_M:
            break
    # x east, y south, z down.
    looking_down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    eye = np.array([centre[0], centre[1], ground + distance])
    return MapView(camera=camera, T_world_camera=from_rotation(looking_down, eye))


def _seen_from_above(town: Town, view: MapView, quality: str) -> U8:
    """The town alone, drawn smaller from nearer."""
    chunks = [
        dataclasses.replace(chunk, vertices_m=chunk.vertices_m / np.float32(_SHRINK)) for chunk in town.chunks
    ]
    T = view.T_world_camera.copy()
    T[:3, 3] /= _SHRINK
    with SceneRenderer(chunks, ModelLibrary({}), quality=quality, unit_m=_SHRINK) as renderer:
        return np.ascontiguousarray(
            renderer.shade(renderer.draw(view.camera, T, Instances()), weather_by_name("ClearNoon").at(0))
        )


def _spawn_points(town: Town) -> Array:
    lanes, stations = TrafficTables(town.network).starting_positions(0, np.zeros((0, 3)))
    return np.asarray(town.network.pose(lanes, stations).position_m)


def _street(
    stage: SensorStage, renderer: SceneRenderer, T: Array, catalog: ActorCatalog, frame: ActorFrame
) -> U8:
    eye = T[:3, 3]
    clear = np.flatnonzero(np.sum((frame.position_m - eye) ** 2, axis=1) > _CLEAR_M**2)
    seen = place_actors(catalog.take(clear), frame.take(clear), stage.library, eye_m=eye)
    camera = Pinhole.from_fov(2 * STREET_PX[0], 2 * STREET_PX[1], 80.0)
    rgb = renderer.shade(renderer.draw(camera, T, seen), stage.weather.at(0))
    return np.asarray(cv2.resize(rgb, STREET_PX, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _labelled(image: U8, text: str) -> U8:
    cv2.rectangle(image, (6, 6), (30, 32), (0, 0, 0), -1)
    cv2.putText(image, text, (11, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.65, (255, 255, 255), 1, cv2.LINE_AA)
    return image


def _mark(plan: U8, view: MapView, T: Array, text: str) -> None:
    """Letter of a street view on the map, with an arrow in its direction."""
    tip = T[:3, 3] + 16.0 * T[:3, 2]
    (a, b), _ = view.pixels(np.stack([T[:3, 3], tip]))
    cv2.arrowedLine(plan, a, b, (0, 0, 0), 5, cv2.LINE_AA, tipLength=0.35)
    cv2.arrowedLine(plan, a, b, (255, 235, 60), 2, cv2.LINE_AA, tipLength=0.35)
    cv2.circle(plan, a, 12, (0, 0, 0), -1, cv2.LINE_AA)
    cv2.putText(
        plan, text, (a[0] - 7, a[1] + 7), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 235, 60), 2, cv2.LINE_AA
    )
