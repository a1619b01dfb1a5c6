"""Recordings of rerun: towns and episodes, and the viewer.

A recording of rerun (.rrd): entities named as our frames, all times on the timeline ``stamp``.

A town as a recording: its solid parts by class, lanes, route and traffic lights.
"""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.ego import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.errors import DeviceError, MissingDependencyError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.core.transforms import matrix_to_quat, quat_rotate, rpy_to_quat
from carlaloc_env.scene.semantic_tags import PALETTE_RGB, Tag
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from recorder.episode.episode import Episode
from recorder.report.town_preview import lane_lines
from recorder.writers.base import DEFAULT_EPOCH_NS

SUFFIX = ".rrd"
"""Suffix of rerun's files."""
TIMELINE = "stamp"
"""The one timeline: Unix time, as in the files of a dataset."""
WORLD, BASE_LINK = "world", "world/base_link"
"""Entities of the world (ENU) and of the car; its sensors lie below it, by the names of their frames."""


class Recording:
    """What is written to one file; times are Unix times [ns], coordinates metres in the entity's frame.

    Args:
        stream: Stream of rerun.
        rerun: The library.
    """

    def __init__(self, stream: Any, rerun: ModuleType) -> None:
        self.rerun: Any = rerun
        self._stream = stream

    def always(self, entity: str, thing: Any, *more: Any) -> None:
        """Log what holds at all times."""
        self._stream.log(entity, thing, *more, static=True, strict=True)

    def at(self, stamp_ns: int, entity: str, thing: Any) -> None:
        """Log what begins to hold at one time [ns]."""
        self._stream.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        self._stream.log(entity, thing, strict=True)
        self._stream.reset_time()

    def columns(self, entity: str, stamp_ns: NDArray[np.int64], columns: Any) -> None:
        """Log many times at once: an archetype's ``columns(...)``, a row for each time [ns]."""
        index = self.rerun.TimeColumn(TIMELINE, timestamp=stamp_ns.astype("datetime64[ns]"))
        self._stream.send_columns(entity, indexes=[index], columns=columns, strict=True)

    def motion(self, entity: str, stamp_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> None:
        """Log poses that map the entity's frame to its parent's, positions (N, 3), quaternions (N, 4)."""
        transforms = self.rerun.Transform3D.columns(translation=position_m, quaternion=quat_xyzw)
        self.columns(entity, stamp_ns, transforms)

    def mount(self, entity: str, T: Array) -> None:
        """Log a pose that never changes: maps the entity's frame to its parent's, shape (4, 4)."""
        quat: Any = matrix_to_quat(T[:3, :3])
        self.always(entity, self.rerun.Transform3D(translation=T[:3, 3], quaternion=quat))

    def path(self, entity: str, position_m: Array, colour: tuple[int, int, int], radius_m: float) -> None:
        """Log a line through positions (N, 3) that is always there."""
        self.always(entity, self.rerun.LineStrips3D([position_m], colors=[colour], radii=[radius_m]))

    def world_view(self, position_m: Array, quat_xyzw: Array) -> Any:
        """A view of the world whose eye stands first behind and above a pose of the car."""
        blueprint = self.rerun.blueprint
        behind_m = position_m + quat_rotate(quat_xyzw, [-22.0, 0.0, 14.0])
        target_m = position_m + quat_rotate(quat_xyzw, [10.0, 0.0, 0.0])
        eye = blueprint.EyeControls3D(position=behind_m, look_target=target_m, eye_up=(0, 0, 1))
        return blueprint.Spatial3DView(origin=WORLD, name="world", eye_controls=eye)

    def show(self, *views: Any) -> None:
        """Lay views out, the first one twice as wide as the others, which stand below each other."""
        blueprint = self.rerun.blueprint
        side = blueprint.Vertical(*views[1:])
        shown = blueprint.Horizontal(views[0], side, column_shares=[2, 1]) if len(views) > 1 else views[0]
        self._stream.send_blueprint(blueprint.Blueprint(shown, collapse_panels=True))


def import_rerun() -> ModuleType:
    """The library, with its blueprints.

    Raises:
        MissingDependencyError: it is not installed.
    """
    try:
        import rerun
        import rerun.blueprint
    except ImportError as error:
        raise MissingDependencyError('rerun is not installed; pip install "carlaloc-env[view]"') from error
    library: ModuleType = rerun
    return library


@contextmanager
def new_recording(path: str | Path, title: str, *, overwrite: bool = False) -> Iterator[Recording]:
    """A recording that is whole, or not there, when the block ends.

    Args:
        path: New file (.rrd).
        title: What the viewer calls it.
        overwrite: Whether an older file is replaced.

    Raises:
        OutputError: the file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    path = check_output_file(path, suffixes=(SUFFIX,), overwrite=overwrite)
    rerun: Any = import_rerun()
    with atomic_write(path) as part:
        stream = rerun.RecordingStream("CarlaLoc", send_properties=False)
        stream.save(part)
        stream.send_recording_name(title)
        recording = Recording(stream, rerun)
        recording.always(WORLD, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, rerun.AnnotationContext(_classes()))
        yield recording
        stream.flush()
        stream.disconnect()


def _classes() -> list[tuple[int, str, tuple[int, ...]]]:
    """Semantic tags with CARLA's names and colours."""
    return [(int(tag), tag.name.lower(), tuple(PALETTE_RGB[tag].tolist())) for tag in Tag]


def check_display() -> None:
    """Make sure that a window can be opened.

    Raises:
        DeviceError: there is no display.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DeviceError(
            "there is no display for rerun's viewer; write a recording with --out FILE.rrd and open that "
            "elsewhere with: rerun FILE.rrd"
        )


def open_viewer(recording: Path) -> None:
    """Show a recording until the viewer is closed.

    It listens to this machine alone, not to all of the network, which is its own default.

    Raises:
        DeviceError: the viewer ended with an error.
    """
    words = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--new", str(recording)]
    status = subprocess.run(words, check=False).returncode
    if status:
        raise DeviceError(f"rerun's viewer ended with exit status {status}; its messages are above")


LANE, ROUTE = (60, 210, 255), (255, 120, 20)
"""Colours of lanes and of the route."""


def record_town(town: Town, path: Path, *, overwrite: bool = False) -> Path:
    """Write a town as a recording.

    Raises:
        OutputError: the file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    with new_recording(path, town.name, overwrite=overwrite) as recording:
        log_town(recording, town)
        recording.show(recording.rerun.blueprint.Spatial3DView(origin=WORLD, name=town.name))
    return path


def log_town(recording: Recording, town: Town) -> None:
    """Log everything solid, an entity for each class, then lanes, the route and signal lenses."""
    rerun = recording.rerun
    solid = town.outline
    for tag in np.unique(solid.collision_tags).tolist():
        corners = solid.collision_vertices_m[solid.collision_triangles[solid.collision_tags == tag]]
        recording.always(
            f"{WORLD}/town/{Tag(tag).name.lower()}",
            rerun.Mesh3D(
                vertex_positions=corners.reshape(-1, 3),
                vertex_normals=np.repeat(_normals(corners), 3, axis=0),
                albedo_factor=PALETTE_RGB[tag],
            ),
        )
    log_lanes(recording, lane_lines(town.network))
    if town.route is not None:
        recording.path(f"{WORLD}/route", town.route.position_m + np.array([0.0, 0.0, 0.3]), ROUTE, 0.3)
    lenses = solid.lenses
    if len(lenses):
        colours = np.array([(40, 40, 40), (255, 40, 40), (255, 210, 40), (40, 230, 80)], np.uint8)
        recording.always(
            f"{WORLD}/signal_lenses",
            rerun.Points3D(lenses.T_world_lens[:, :3, 3], colors=colours[lenses.state], radii=[0.15]),
        )


def log_lanes(recording: Recording, lines_m: Sequence[Array]) -> None:
    """Log the centre lines of driving lanes, if there are some."""
    if lines_m:
        above = [line + np.array([0.0, 0.0, 0.1]) for line in lines_m]
        recording.always(f"{WORLD}/lanes", recording.rerun.LineStrips3D(above, colors=[LANE], radii=[0.08]))


def _normals(corners_m: Array) -> Array:
    """Unit normals of triangles (T, 3, 3), shape (T, 3)."""
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    unit: Array = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return unit


_EGO_COLOUR, _SIGNALS = (240, 240, 240), ((0, 0, 0), (255, 40, 40), (255, 210, 40), (40, 230, 80))
"""Colours of the ego, and of signals that are off, red, yellow and green."""


def record_episode(episode: Episode, town: Town, path: Path, *, overwrite: bool = False) -> Path:
    """Write a drive as a recording.

    Args:
        episode: The drive.
        town: Its town.
        path: New file (.rrd).
        overwrite: Whether an older file is replaced.

    Raises:
        OutputError: the file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    with new_recording(path, episode.path.name, overwrite=overwrite) as recording:
        log_town(recording, town)
        timeline = episode.timeline()
        _log_ego(recording, episode)
        _log_actors(recording, timeline, len(episode.steps))
        _log_signals(recording, town, np.asarray(episode.steps["signals"]))
        for event in episode.events:
            text = recording.rerun.TextLog(f"{event.kind} {event.data or ''}".strip())
            recording.at(event.stamp_ns + DEFAULT_EPOCH_NS, "events", text)
        blueprint = recording.rerun.blueprint
        recording.show(
            recording.world_view(episode.ego["position_m"][0], episode.ego["quat_xyzw"][0]),
            blueprint.TimeSeriesView(origin="speed_mps", name="speed [m/s]"),
            blueprint.TimeSeriesView(origin="controls", name="controls"),
            blueprint.TextLogView(origin="events", name="events"),
        )
    return path


def _log_ego(recording: Recording, episode: Episode) -> None:
    ego = episode.ego
    stamp_ns = np.asarray(ego["tick"], np.int64) * TICK_NS + DEFAULT_EPOCH_NS
    recording.motion(BASE_LINK, stamp_ns, ego["position_m"], ego["quat_xyzw"])
    recording.path(f"{WORLD}/driven", ego["position_m"][::20] + np.array([0.0, 0.0, 0.2]), _EGO_COLOUR, 0.1)
    half_m = 0.5 * np.asarray(EGO_SIZE_M)
    recording.always(
        f"{BASE_LINK}/ego",
        recording.rerun.Boxes3D(
            centers=[(EGO_REAR_M + half_m[0], 0.0, half_m[2])],
            half_sizes=[half_m],
            colors=[_EGO_COLOUR],
            fill_mode="solid",
        ),
    )
    for name in ("speed_mps", "steer", "throttle", "brake"):
        entity = name if name == "speed_mps" else f"controls/{name}"
        recording.columns(entity, stamp_ns, recording.rerun.Scalars.columns(scalars=ego[name]))


def _log_actors(recording: Recording, timeline: Timeline, steps: int) -> None:
    """Boxes of all actors at every step of 50 ms."""
    catalog = timeline.catalog
    count = len(catalog)
    if not (count and steps):
        return
    stamp_ns = np.arange(steps, dtype=np.int64) * STEP_NS
    frames = [timeline.actors_at(int(stamp)) for stamp in stamp_ns]
    half_m = 0.5 * catalog.size_m.astype(np.float64)
    centre_m = np.stack([frame.position_m for frame in frames]) + half_m * [0.0, 0.0, 1.0]
    roll, pitch, heading = (
        np.stack([getattr(frame, f"{name}_rad") for frame in frames]).astype(np.float64)
        for name in ("roll", "pitch", "heading")
    )
    boxes = recording.rerun.Boxes3D.columns(
        centers=centre_m.reshape(-1, 3),
        quaternions=rpy_to_quat(roll, -pitch, heading).reshape(-1, 4),
        half_sizes=np.tile(half_m, (steps, 1)),
        class_ids=np.tile(catalog.tag, steps),
    )
    boxes = boxes.partition(lengths=np.full(steps, count))
    recording.columns(f"{WORLD}/actors", stamp_ns + DEFAULT_EPOCH_NS, boxes)
    recording.always(f"{WORLD}/actors", recording.rerun.Boxes3D.from_fields(fill_mode="solid"))


def _log_signals(recording: Recording, town: Town, states: Array) -> None:
    """The lit lens of every head, whenever one of them changes."""
    lenses = town.outline.lenses
    if not (len(lenses) and states.size):
        return
    changed = np.flatnonzero(np.append(True, (states[1:] != states[:-1]).any(axis=1)))
    for step in changed.tolist():
        lit = states[step][lenses.signal] == lenses.state
        recording.at(
            step * STEP_NS + DEFAULT_EPOCH_NS,
            f"{WORLD}/signals",
            recording.rerun.Points3D(
                lenses.T_world_lens[lit, :3, 3],
                colors=np.array(_SIGNALS, np.uint8)[lenses.state[lit]],
                radii=[0.35],
            ),
        )
