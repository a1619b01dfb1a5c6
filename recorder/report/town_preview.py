"""Towns from above: maps, previews, lists.

One sheet about a town: from above with lanes, route, spawn points and lights, and four street views.

What is drawn over a town seen from above: lanes, route, spawn points, lights, a legend and a scale.

Centre lines of a town's driving lanes, for maps.

Towns by name: what each is, and how large.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import place_actors
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError, is_name
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.core.transforms import R_FLU_OPTICAL, apply, from_rotation, invert
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.sources import known_towns
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.render.views import FAR_M
from carlaloc_env.scene.mesh import Instances, ModelLibrary
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.standing_traffic import TrafficTables, standing_traffic
from carlaloc_env.weather.presets import weather_by_name


def lane_lines(network: LaneNetwork) -> list[Array]:
    """Centre lines of driving lanes [m], shape (K, 3) each."""
    tables = network.tables
    return [
        tables.position_m[int(tables.first[lane.index]) :][: int(tables.count[lane.index])]
        for lane in network.lanes
        if lane.type == "driving"
    ]


def lane_lines_of(town: str) -> list[Array]:
    """The same of a town that is known by name; of others nothing is known."""
    source = known_towns().get(town) if is_name(town) else None
    return [] if source is None else lane_lines(build_network(read_opendrive(source)))


Point = tuple[int, int]
Rgb = tuple[int, int, int]

LANE: Rgb = (60, 210, 255)
ROUTE: Rgb = (255, 120, 20)
SPAWN: Rgb = (60, 230, 90)
SIGNAL: Rgb = (255, 40, 60)
LAMP: Rgb = (255, 236, 150)
STRIP_PX = 64
"""Height of the strip below the map [px]."""
_BAR_M = (1, 2, 5, 10, 20, 50, 100, 200, 500)
_BAR_ROOM_PX = 140
"""Width that stays free for the scale [px]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapView:
    """A camera that looks down on a town."""

    camera: Pinhole
    T_world_camera: Array

    def pixels(self, points_m: Array) -> tuple[list[Point], NDArray[np.bool_]]:
        """Pixels of world points (N, 3), and whether each lies in the image, shape (N,)."""
        uv = np.rint(self.camera.project(apply(invert(self.T_world_camera), points_m))).astype(int)
        inside = (uv[:, 0] >= 0) & (uv[:, 0] < self.camera.width_px)
        inside &= (uv[:, 1] >= 0) & (uv[:, 1] < self.camera.height_px)
        return [(int(u), int(v)) for u, v in uv], inside

    def px_per_m(self, z_m: float) -> float:
        """Scale at a height [px/m]."""
        return float(self.camera.fx_px / (self.T_world_camera[2, 3] - z_m))


def draw_map(town: Town, view: MapView, image: U8, spawn_m: Array) -> U8:
    """The view from above with everything marked and a legend below it, sRGB, shape (H + STRIP_PX, W, 3).

    Args:
        town: The town.
        view: The camera of the image.
        image: The town seen by it.
        spawn_m: Places where vehicles start [m], shape (K, 3).
    """
    plan = (0.80 * image).astype(np.uint8)
    for line in lane_lines(town.network):
        _line(plan, view, line, LANE, 1)
    _dots(plan, view, spawn_m, SPAWN, 2)
    _dots(plan, view, town.outline.lamps_m, LAMP, 1)
    if town.route is not None:
        line = town.route.position_m
        line = np.concatenate([line, line[:1]]) if town.route.closed else line
        _line(plan, view, line, (0, 0, 0), 6)
        _line(plan, view, line, ROUTE, 3)
        ends = view.pixels(town.route.position_m[[0, -1]])[0]
        cv2.circle(plan, ends[0], 9, (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(plan, ends[0], 6, ROUTE, -1, cv2.LINE_AA)
        if not town.route.closed:
            cv2.drawMarker(plan, ends[1], (255, 255, 255), cv2.MARKER_TILTED_CROSS, 18, 5, cv2.LINE_AA)
            cv2.drawMarker(plan, ends[1], ROUTE, cv2.MARKER_TILTED_CROSS, 16, 2, cv2.LINE_AA)
    _dots(plan, view, np.asarray(town.outline.lenses.T_world_lens[:, :3, 3]), SIGNAL, 4)
    px_per_m = view.px_per_m(float(np.median(town.network.tables.position_m[:, 2])))
    return np.vstack([plan, _strip(town, len(spawn_m), plan.shape[1], px_per_m)])


def _line(plan: U8, view: MapView, points_m: Array, colour: Rgb, width_px: int) -> None:
    corners = np.array(view.pixels(points_m)[0], dtype=np.int32)
    cv2.polylines(plan, [corners], False, colour, width_px, cv2.LINE_AA)


def _dots(plan: U8, view: MapView, points_m: Array, colour: Rgb, radius_px: int) -> None:
    if not len(points_m):
        return
    pixels, inside = view.pixels(points_m)
    for k in np.flatnonzero(inside):
        cv2.circle(plan, pixels[k], radius_px, colour, -1, cv2.LINE_AA)


def _strip(town: Town, spawn_points: int, width_px: int, px_per_m: float) -> U8:
    """Name, scale and the meaning of the colours, in a strip below the map."""
    strip = np.full((STRIP_PX, width_px, 3), 24, np.uint8)
    font, base = cv2.FONT_HERSHEY_SIMPLEX, STRIP_PX // 2 + 7
    length = "no route" if town.route is None else f"route {town.route.length_m:.0f} m"
    signals = len(np.unique(town.outline.lenses.signal))
    rows: tuple[tuple[str, Rgb], ...] = (
        (length, ROUTE),
        ("driving lanes", LANE),
        (f"{spawn_points} spawn points", SPAWN),
        (f"{signals} traffic lights", SIGNAL),
        (f"{len(town.outline.lamps_m)} street lamps", LAMP),
    )
    widths_px = [40 + cv2.getTextSize(text, font, 0.58, 1)[0][0] for text, _ in rows]
    name = town.name
    while cv2.getTextSize(name, font, 1.0, 2)[0][0] > width_px - sum(widths_px) - 40 - _BAR_ROOM_PX:
        name = name[:-1]
    cv2.putText(strip, name, (16, base + 3), font, 1.0, (255, 255, 255), 2, cv2.LINE_AA)
    x = 40 + cv2.getTextSize(name, font, 1.0, 2)[0][0]
    for (text, colour), own_px in zip(rows, widths_px, strict=True):
        cv2.circle(strip, (x, base - 6), 7, colour, -1, cv2.LINE_AA)
        cv2.putText(strip, text, (x + 16, base), font, 0.58, (255, 255, 255), 1, cv2.LINE_AA)
        x += own_px
    bar_m = max((m for m in _BAR_M if m * px_per_m < width_px - x - 60), default=_BAR_M[0])
    end = width_px - 24
    begin = end - round(bar_m * px_per_m)
    cv2.line(strip, (begin, base + 8), (end, base + 8), (255, 255, 255), 3, cv2.LINE_AA)
    cv2.putText(strip, f"{bar_m} m", (begin, base - 4), font, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
    if "OpenStreetMap" in town.config.description:
        words = "(c) OpenStreetMap contributors"
        cv2.putText(strip, words, (16, STRIP_PX - 5), font, 0.42, (200, 200, 200), 1, cv2.LINE_AA)
    return strip


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


@dataclass(frozen=True, slots=True, kw_only=True)
class TownEntry:
    """One town of the list."""

    name: str
    """Name of its folder."""
    description: str
    """Its description in `town.toml`."""
    lane_km: float
    """Length of all driving lanes, those in junctions included [km]."""
    junctions: int
    """Junctions."""
    route_m: float
    """Length of the ego's route [m]; 0 where none is given."""
    path: str
    """OpenDRIVE file."""


def list_towns() -> tuple[TownEntry, ...]:
    """All towns in `$CARLALOC_MAPS` and among the installed maps; none is checked or built.

    Raises:
        MapError: a map cannot be read.
        ConfigError: a `town.toml` is not valid.
    """
    towns = []
    for name, path in known_towns().items():
        toml = path.with_name("town.toml")
        config = TownConfig.from_toml(toml) if toml.exists() else TownConfig(name=name)
        xodr = read_opendrive(path)
        network = build_network(xodr)
        driving = np.array([lane.type == "driving" for lane in network.lanes], dtype=bool)
        towns.append(
            TownEntry(
                name=name,
                description=config.description,
                lane_km=float(network.tables.length_m[driving].sum()) / 1e3,
                junctions=len(xodr.junctions),
                route_m=config.route.length_m or 0.0,
                path=str(path),
            )
        )
    return tuple(towns)
