"""An episode as a recording of rerun: the ego's path, actors, signals and events."""

from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.ego import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.transforms import rpy_to_quat
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from recorder.episode.episode import Episode
from recorder.view.recording import (
    BASE_LINK,
    WORLD,
    Recording,
    new_recording,
)
from recorder.view.town_recording import log_town
from recorder.writers.base import DEFAULT_EPOCH_NS

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
