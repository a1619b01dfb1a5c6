"""A town, a drive or a sequence as one HTML file that opens in a browser, offline.

The page holds its data, packed, and three.js. Its own program is ``page/scene.js``.
"""

import base64
import gzip
import json
from collections.abc import Iterator, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array, Mask
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.ego import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.map.sources import known_towns
from carlaloc_env.render.textures.build import build_textures
from carlaloc_env.samples.gnss_signals import WAYS
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import PALETTE_RGB, Tag
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from recorder.dataset.layout import whole_path
from recorder.dataset.sequence import SlamSequence
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import TrafficLevel
from recorder.evaluation.path_errors import PathErrors
from recorder.evaluation.trajectory_files import read_tum
from recorder.report.lane_lines import lane_lines, lane_lines_of
from recorder.view.sequence_view import COLOURS, TRUTH, every, greys, in_world, jpeg_of
from recorder.view.sky import COLOURS as COLOURS_OF_WAYS
from recorder.view.sky import SkyOverTime, read_sky

THREE_VERSION = "0.187.0"
"""Version of three.js in ``page/three.min.js.gz``; .ci/three makes that file."""
SUFFIX = ".html"
"""Suffix of pages."""
RADII_M, TOWN_BYTES = (400.0, 250.0, 160.0, 100.0, 60.0), 6_000_000
"""The town is shown up to the largest of these distances from the drive at which its packed size fits."""
POINTS_MAX = 6500
"""Points shown of a sweep."""
PICTURE_WIDTH_PX, JPEG_QUALITY = 480, 70
"""Width of pictures and their quality."""
EGO_HZ = 20
"""Poses of the ego a second."""


class ScenePage:
    """A page while it is put together.

    Args:
        title: Heading of the page.
        origin_m: Place in the world that becomes the page's origin, shape (3,).
        begin_ns: Time that becomes the page's 0 [ns].
    """

    def __init__(self, title: str, origin_m: Array, begin_ns: int = 0) -> None:
        self._title, self._origin_m, self._begin_ns = title, np.round(origin_m), begin_ns
        self._data = bytearray()
        self._meta: dict[str, Any] = {"town": [], "lanes": [], "paths": [], "end_s": 0.0, "opens_s": 0.0}

    def _part(self, values: NDArray[Any], kind: str) -> dict[str, Any]:
        """Numbers as the page finds them; `kind` is a type of numpy."""
        self._data += b"\0" * (-len(self._data) % 4)
        flat = np.ascontiguousarray(values, f"<{kind}")
        part = {"type": kind, "at": len(self._data), "count": flat.size}
        self._data += flat.tobytes()
        return part

    def _times(self, stamp_ns: NDArray[np.int64]) -> dict[str, Any]:
        seconds = (stamp_ns - self._begin_ns) * 1e-9
        self._meta["end_s"] = max(self._meta["end_s"], float(seconds.max(initial=0.0)))
        return self._part(seconds, "f4")

    def _steps(self, points_m: Array) -> dict[str, Any]:
        """Points as whole steps from their lowest corner."""
        local = points_m - self._origin_m
        low = local.min(axis=0)
        step = np.maximum((local.max(axis=0) - low) / 65535.0, 1e-3)
        whole = np.rint((local - low) / step)
        return {"position": self._part(whole, "u2"), "low": low.tolist(), "step": step.tolist()}

    def open_at(self, stamp_ns: int) -> None:
        """Open the page at a time [ns]."""
        self._meta["opens_s"] = (stamp_ns - self._begin_ns) * 1e-9

    def add_town(self, town: Town, path_m: Array | None = None) -> None:
        """Add a town's surfaces in their materials' mean colours.

        Args:
            town: The town.
            path_m: Only what is near these places is added [m], (N, 3); None: all.
        """
        texture = np.asarray(build_textures(64).albedo[..., :3], np.float32).mean(axis=(1, 2))
        if path_m is None:
            self._add_meshes(town.chunks, texture)
            return
        for radius_m in RADII_M:
            size = len(self._data)
            self._meta["town"] = []
            parts = [near for chunk in town.chunks for near in _near(chunk, path_m, radius_m)]
            self._add_meshes(parts, texture)
            if len(gzip.compress(bytes(self._data[size:]), 6)) <= TOWN_BYTES or radius_m == RADII_M[-1]:
                return
            del self._data[size:]

    def _add_meshes(self, chunks: Sequence[Mesh], texture: Array) -> None:
        for on_top in (False, True):
            meshes = [part for chunk in chunks for part in _of_lines(chunk, on_top)]
            if not meshes:
                continue
            first = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])
            linear = np.concatenate([texture[m.material] * m.colour / 255.0 for m in meshes])
            index = np.concatenate([m.triangles + n for m, n in zip(meshes, first[:-1], strict=True)])
            part = self._steps(np.concatenate([mesh.vertices_m for mesh in meshes]).astype(np.float64))
            part["colour"] = self._part(np.rint(255.0 * np.clip(linear, 0.0, 1.0)), "u1")
            self._meta["town"].append({**part, "index": self._part(index, "u4"), "on_top": on_top})
        whole = np.concatenate([chunk.bounds_m for chunk in chunks]) - self._origin_m
        low, high = whole.min(axis=0), whole.max(axis=0)
        middle = 0.5 * (low + high)
        self._meta["centre"] = [float(middle[0]), float(middle[1]), float((high - low)[:2].max())]

    def add_lanes(self, lines_m: Sequence[Array]) -> None:
        """Add centre lines of lanes, a sample of each four."""
        for line in lines_m:
            thin = np.concatenate([line[:-1:4], line[-1:]]) - self._origin_m + [0.0, 0.0, 0.08]
            self._meta["lanes"].append(self._part(thin, "f4"))

    def add_ego(self, stamp_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> None:
        """Add the motion of `base_link`."""
        length, width, height = EGO_SIZE_M
        self._meta["ego"] = {
            "time": self._times(stamp_ns),
            "position": self._part(position_m - self._origin_m, "f4"),
            "quat": self._part(quat_xyzw, "f4"),
            "size": [length, width, height],
            "ahead": EGO_REAR_M + 0.5 * length,
        }

    def add_path(
        self, name: str, position_m: Array, colour: tuple[int, int, int], lift_m: float = 0.3
    ) -> None:
        """Add a line with an entry in the legend."""
        self._meta["paths"].append(
            {
                "name": name,
                "colour": _hex(colour),
                "position": self._part(position_m - self._origin_m + [0.0, 0.0, lift_m], "f4"),
            }
        )

    def add_actors(self, timeline: Timeline, first_step: int, end_step: int, epoch_ns: int = 0) -> None:
        """Add boxes of all actors, at every second step.

        Args:
            timeline: The drive.
            first_step: First step that is shown.
            end_step: The step behind the last one.
            epoch_ns: Time of the drive's begin, where the page's times have another 0 [ns].
        """
        catalog = timeline.catalog
        if not (len(catalog) and first_step < end_step):
            return
        stamp_ns = np.arange(first_step, end_step, 2, dtype=np.int64) * STEP_NS
        frames = [timeline.actors_at(int(stamp)) for stamp in stamp_ns]
        size = catalog.size_m.astype(np.float64)
        centre = np.stack([frame.position_m for frame in frames]) + [0.0, 0.0, 0.5] * size - self._origin_m
        heading = np.stack([frame.heading_rad for frame in frames])
        painted = np.any(catalog.tint, axis=1, keepdims=True)
        shades = (255.0 * (catalog.tint / 255.0) ** (1 / 2.2)).astype(np.uint8)
        self._meta["actors"] = {
            "count": len(catalog),
            "time": self._times(stamp_ns + epoch_ns),
            "pose": self._part(np.concatenate([centre, heading[..., None]], axis=-1), "f4"),
            "size": self._part(size, "f4"),
            "colour": self._part(np.where(painted, shades, PALETTE_RGB[catalog.tag]), "u1"),
        }

    def add_clouds(self, clouds: Iterator[tuple[int, Array, U8]], table: U8, period_s: float) -> None:
        """Add points over time.

        Args:
            clouds: Time [ns], points in the world [m] and their rows of the table, of each sweep.
            table: Colours (sRGB), shape (256, 3); the page computes in linear light.
            period_s: Time between sweeps [s].
        """
        stamps, points, shades = [], [], []
        for stamp_ns, world_m, shade in clouds:
            step = -(-len(world_m) // POINTS_MAX) or 1
            stamps.append(stamp_ns)
            points.append(world_m[::step])
            shades.append(shade[::step])
        if not stamps:
            return
        self._meta["clouds"] = {
            **self._steps(np.concatenate(points)),
            "time": self._times(np.array(stamps)),
            "first": self._part(np.cumsum([0, *map(len, points)]), "u4"),
            "shade": self._part(np.concatenate(shades), "u1"),
            "table": self._part(255.0 * (table / 255.0) ** 2.2, "u1"),
            "period": period_s,
        }

    def add_pictures(self, pictures: Iterator[tuple[int, bytes]]) -> None:
        """Add JPEG files with their times [ns]."""
        rows = list(pictures)
        if rows:
            jpeg = np.frombuffer(b"".join(data for _, data in rows), np.uint8)
            self._meta["pictures"] = {
                "time": self._times(np.array([stamp for stamp, _ in rows])),
                "first": self._part(np.cumsum([0, *(len(data) for _, data in rows)]), "u4"),
                "jpeg": self._part(jpeg, "u1"),
            }

    def add_sky(self, sky: SkyOverTime) -> None:
        """Add satellites over time."""
        names, of = np.unique(sky.name, return_inverse=True)
        self._meta["sky"] = {
            "time": self._times(sky.stamp_ns),
            "first": self._part(sky.first, "u4"),
            "name": self._part(of, "u1"),
            "names": names.tolist(),
            "place": self._part(sky.place, "f4"),
            "way": self._part(sky.way, "u1"),
            "ways": list(zip(WAYS, map(_hex, COLOURS_OF_WAYS), strict=True)),
        }

    def write(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the page.

        Raises:
            OutputError: the file may not be written.
        """
        path = check_output_file(path, suffixes=(SUFFIX,), overwrite=overwrite)
        page = files("recorder.view") / "page"
        texts = {
            "TITLE": escape(self._title),
            "THREE_VERSION": THREE_VERSION,
            "META": json.dumps(self._meta).replace("</", "<\\/"),
            "SCENE": (page / "scene.js").read_text("utf-8"),
            "THREE": gzip.decompress((page / "three.min.js.gz").read_bytes()).decode("utf-8"),
            "DATA": base64.b64encode(gzip.compress(bytes(self._data), 9, mtime=0)).decode("ascii"),
        }
        text = (page / "scene.html").read_text("utf-8")
        for name, value in texts.items():
            text = text.replace(f"%{name}%", value)
        return write_whole(path, text)


def _hex(colour: tuple[int, int, int]) -> str:
    """A colour as a page names it."""
    return "#" + "".join(f"{part:02x}" for part in colour)


def _near(chunk: Mesh, path_m: Array, radius_m: float) -> Iterator[Mesh]:
    """The triangles of a chunk that have a corner near a path."""
    low, high = chunk.bounds_m[:, :2]
    places = path_m[:, :2]
    away = np.maximum(np.maximum(low - places, places - high), 0.0)
    places = places[np.hypot(away[:, 0], away[:, 1]) < radius_m]
    if not len(places):
        return
    corner = chunk.vertices_m[chunk.triangles[:, 0], :2].astype(np.float64)
    # Cells of a quarter of the radius decide for all their corners.
    cell = np.floor(corner / (0.25 * radius_m)).astype(np.int64)
    cells, of = np.unique(cell, axis=0, return_inverse=True)
    middles = (cells + 0.5) * 0.25 * radius_m
    least = np.array([np.hypot(*(places - middle).T).min() for middle in middles])
    yield from _part(chunk, (least < radius_m)[of.reshape(-1)])


def _of_lines(chunk: Mesh, lines: bool) -> Iterator[Mesh]:
    """Triangles of a chunk's road markings, or all others."""
    yield from _part(chunk, (chunk.tag[chunk.triangles[:, 0]] == Tag.ROAD_LINE) == lines)


def _part(chunk: Mesh, chosen: Mask) -> Iterator[Mesh]:
    """The chosen triangles of a chunk, if there are some."""
    if chosen.any():
        vertices, index = np.unique(chunk.triangles[chosen], return_inverse=True)
        yield chunk.taking(vertices, index.reshape(-1, 3).astype(np.uint32))


def page_of_town(town: Town, path: Path, *, overwrite: bool = False) -> Path:
    """Write a town as a page.

    Raises:
        OutputError: the file may not be written.
    """
    bounds = np.stack([chunk.bounds_m for chunk in town.chunks])
    middle = 0.5 * (bounds[:, 0].min(axis=0) + bounds[:, 1].max(axis=0)).astype(np.float64)
    page = ScenePage(town.name, np.array([middle[0], middle[1], 0.0]))
    page.add_town(town)
    page.add_lanes(lane_lines(town.network))
    return page.write(path, overwrite=overwrite)


def page_of_episode(episode: Episode, town: Town, path: Path, *, overwrite: bool = False) -> Path:
    """Write a drive as a page.

    Raises:
        OutputError: the file may not be written.
    """
    rows = episode.ego[:: round(1e9 / TICK_NS / EGO_HZ)]
    position = np.asarray(rows["position_m"], np.float64)
    page = ScenePage(f"{town.name}, {episode.path.name}", position[0])
    page.add_town(town, position)
    page.add_lanes(lane_lines(town.network))
    page.add_ego(np.asarray(rows["tick"], np.int64) * TICK_NS, position, np.asarray(rows["quat_xyzw"]))
    page.add_path("driven", position, TRUTH)
    page.add_actors(episode.timeline(), 0, len(episode.steps))
    return page.write(path, overwrite=overwrite)


def page_of_sequence(
    sequence: SlamSequence,
    path: Path,
    *,
    estimates: Sequence[PathErrors] = (),
    period_s: float,
    drive: Episode | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a sequence as a page, which opens where the first estimate begins to leave the truth.

    Args:
        sequence: The sequence; clouds, pictures and the sky of raw GNSS are left out where it has none.
        path: New file (.html).
        estimates: Estimates behind their fit, with their errors.
        period_s: Time between two clouds or pictures that are shown [s].
        drive: The drive of the sequence, whose movers are shown; None: none are.
        overwrite: Whether an older file is replaced.

    Raises:
        OutputError: the file may not be written.
        EvaluationError: the truth cannot be read, or a bag or image is damaged.
    """
    name = whole_path(sequence.folder).parent.name
    truth = read_tum(sequence.truth_file("base_link"))
    step = max(round(len(truth) / (1e-9 * float(np.ptp(truth.stamp_ns)) + 1e-9) / EGO_HZ), 1)
    title = f"{name}, {sequence.name.replace('_', ' ')}"
    page = ScenePage(title, truth.position_m[0], int(truth.stamp_ns[0]))
    if name in known_towns():
        page.add_town(load_town(name), truth.position_m[::20])
    page.add_lanes(lane_lines_of(name))
    page.add_ego(truth.stamp_ns[::step], truth.position_m[::step], truth.quat_xyzw[::step])
    if not estimates:
        page.add_path("truth", truth.position_m[::step], TRUTH)
    for k, estimate in enumerate(estimates):
        # Paths of a sensor on the roof are drawn on the road, below it.
        height_m = float(np.median(estimate.truth_m[:, 2] - truth.at(estimate.stamp_ns).position_m[:, 2]))
        if k == 0:
            page.add_path("truth", estimate.truth_m, TRUTH, 0.3 - height_m)
        error_m = np.sqrt(np.mean(estimate.error_m**2))
        colour = COLOURS[k % len(COLOURS)]
        page.add_path(f"{estimate.name}, {error_m:.3f} m", estimate.estimate_m, colour, 0.33 - height_m)
    if estimates:
        page.open_at(estimates[0].leaves_truth_at_ns())
    if drive is not None:
        description = sequence.description
        steps = (truth.stamp_ns[[0, -1]] - description.epoch_ns) // STEP_NS
        movers = TrafficLevel(**description.traffic).select(drive.timeline())
        page.add_actors(movers, int(steps[0]), int(steps[1]), description.epoch_ns)
    if sequence.rig.of_kind("lidar"):
        page.add_clouds(_clouds(sequence, period_s), _TABLE, period_s)
    page.add_pictures(_pictures(sequence, period_s))
    sky = read_sky(sequence)
    if sky is not None:
        page.add_sky(sky)
    return page.write(path, overwrite=overwrite)


_TABLE: U8 = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
_TABLE[: len(PALETTE_RGB)] = np.rint(0.55 * PALETTE_RGB + 0.45 * 255.0)
"""Colours of points: paler ones of their tags, and greys of intensity from 64 on."""


def _clouds(sequence: SlamSequence, period_s: float) -> Iterator[tuple[int, Array, U8]]:
    truth = read_tum(sequence.truth_file("lidar"))
    for scan in every(sequence.scans(), period_s):
        shade = greys(scan, 64) if scan.tag is None else scan.tag
        yield scan.stamp_ns, in_world(scan, truth), shade


def _pictures(sequence: SlamSequence, period_s: float) -> Iterator[tuple[int, bytes]]:
    """Pictures of the first camera, in colour where a format has them so."""
    cameras = sequence.rig.of_kind("camera")
    if not cameras:
        return
    name = cameras[0].name
    place = sequence.files.place
    places = (
        (place("colmap") / "images", f"{name}_{'?' * 19}.png"),
        (place("raw") / f"rgb_{name}", "*.png"),
        (place("euroc") / "cam0" / "data", "*.png"),
    )
    files = next((files for folder, pattern in places if (files := sorted(folder.glob(pattern)))), [])
    following_ns = 0
    for file in files:
        stamp_ns = int(file.stem.rpartition("_")[2])
        if stamp_ns < following_ns:
            continue
        following_ns = stamp_ns + round(0.999e9 * period_s)
        picture = cv2.imread(str(file))
        if picture is None:
            raise EvaluationError(f"{file} is no image; replay it anew")
        yield stamp_ns, jpeg_of(picture, PICTURE_WIDTH_PX, JPEG_QUALITY)
