"""An episode: a recorded drive, read back bit for bit into a Timeline.

The file is MCAP with ROS 2 message definitions inside, so that any MCAP tool opens it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.recordings import recording_path
from carlaloc_env.core.transforms import matrix_to_quat
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.timeline.vehicle_track import CarTrack
from recorder.episode.actor_messages import ACTORS, actor_frames, unpack_actors
from recorder.episode.ego_messages import CONTROLS, EVENT, Event, ego_record
from recorder.episode.episode_header import HEADER_RECORD, EpisodeHeader
from recorder.episode.mcap_container import Container, is_container, read_container

if TYPE_CHECKING:
    from carlaloc_env.timeline.ego_spline import EgoTrack


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlLog:
    """Controls of every tick, as the physics took them or as the device gave them."""

    steer: NDArray[np.float64]
    """Steering −1…1 per tick, left positive, shape (K,)."""
    throttle: NDArray[np.float64]
    """Throttle pedal 0–1 per tick, shape (K,)."""
    brake: NDArray[np.float64]
    """Brake pedal 0–1 per tick, shape (K,)."""
    reverse: NDArray[np.bool_]
    """Whether the reverse gear is engaged, shape (K,)."""
    handbrake: NDArray[np.bool_]
    """Whether the handbrake is pulled, shape (K,)."""

    def __len__(self) -> int:
        return len(self.steer)

    def at(self, tick: int) -> Controls:
        """Controls of one tick."""
        return Controls(**{name: getattr(self, name)[tick].item() for name in CONTROLS})


class Episode:
    """A recorded drive."""

    def __init__(
        self,
        header: EpisodeHeader,
        egos: Sequence[NDArray[np.void]],
        steps: NDArray[np.void],
        events: tuple[Event, ...],
        *,
        path: Path,
        last_good_ns: int,
        problem: str | None,
        car: int = 1,
    ) -> None:
        own = header.cars[car - 1] if header.cars else {}
        self.header = replace(header, **{name: own[name] for name in ("device", "route") if name in own})
        """Configuration of the drive, with device and route of this car."""
        self.car = car
        """Number of the car whose drive it is, from 1."""
        self.egos = tuple(egos)
        """Of every car, rows of the layout of `ego_messages.EGO`, one per tick."""
        self.ego = self.egos[car - 1]
        """Rows of this car."""
        self._all_events = events
        events = tuple(event for event in events if event.data.get("car", 1) == car)
        self.steps = steps
        """Rows of the layout of `actor_messages.ACTORS`, one per 50 ms step."""
        self.events = events
        """Events of the drive, in order."""
        self.path = path
        """File that was read."""
        self.last_good_ns = last_good_ns
        """Newest whole message [ns]."""
        self.problem = problem
        """Why the file is not whole, or None."""

    @classmethod
    def load(cls, path: str | Path, *, allow_partial: bool = False, car: int = 1) -> Episode:
        """Read an episode; without the final name its `.recording` file is read.

        Args:
            path: File to read.
            allow_partial: Whether a recording that was cut off is read up to where it is good.
            car: Car whose drive it is, from 1.

        Raises:
            EpisodeError: there is no such car, or the file is missing, foreign, damaged, or cut off (with the
                last good time).
        """
        path = episode_file(path)
        container = read_episode_file(path)
        header = next((values for name, values in container.metadata if name == HEADER_RECORD), None)
        if header is None:
            why = f" ({container.problem})" if container.problem else ""
            raise EpisodeError(f"{path} is no CarlaLoc episode: it has no header{why}; give another file")
        if container.problem and not allow_partial:
            raise EpisodeError(
                f"{path} ends early: {container.problem}; "
                f"last good time {container.last_good_ns / 1e9:.3f} s; "
                f"`carlaloc info --repair {path}` saves the good part"
            )
        return _assemble(path, EpisodeHeader.from_metadata(header), container).of_car(car)

    def of_car(self, car: int) -> Episode:
        """The drive of one of its cars, from 1.

        Raises:
            EpisodeError: there are not so many.
        """
        if not 1 <= car <= len(self.egos):
            raise EpisodeError(f"{self.path} has no car {car}; give 1 to {len(self.egos)}")
        return Episode(
            self.header, self.egos, self.steps, self._all_events, path=self.path,
            last_good_ns=self.last_good_ns, problem=self.problem, car=car,
        )  # fmt: skip

    @property
    def complete(self) -> bool:
        """Whether the file was closed and is whole."""
        return self.problem is None

    @property
    def duration_s(self) -> float:
        """Time from the first to the last tick [s]."""
        return max(len(self.ego) - 1, 0) * TICK_S

    @cached_property
    def ego_at_steps(self) -> NDArray[np.void]:
        """Rows of `ego` at the steps of `steps`."""
        tick = np.searchsorted(self.ego["tick"], self.steps["step"].astype(np.int64) * STEP_TICKS)
        return self.ego[np.minimum(tick, len(self.ego) - 1)]

    @cached_property
    def controls(self) -> ControlLog:
        """Controls that the physics took."""
        return self._log("")

    @cached_property
    def raw_controls(self) -> ControlLog:
        """The device's axes before shaping."""
        return self._log("raw_")

    @property
    def car_ids(self) -> list[int]:
        """Instance id of each car where another one sees it."""
        if self.header.cars:
            return [int(car["id"]) for car in self.header.cars]
        return [int(max(self.header.catalog.id.tolist(), default=EGO_INSTANCE)) + 1]

    def timeline(self, T_world_unit: Array | None = None) -> Timeline:
        """The whole drive, equal bit for bit to that of the live sensors.

        Args:
            T_world_unit: Pose of a fixed unit that takes the place of the car and sees it as all others,
                shape (4, 4).
        """
        if self.header.cars or T_world_unit is not None:
            # Here, since numba takes half a second to import.
            from carlaloc_env.timeline.driven_cars import DrivenCars

            cars = DrivenCars(self.car_ids, [_tracks(rows) for rows in self.egos], int(Tag.CAR))
            unit = {} if T_world_unit is None else _fixed(T_world_unit, len(self.ego))
            timeline = Timeline(self.header.catalog, cars=cars, own=None if unit else self.car - 1, **unit)
        else:
            track, car = _tracks(self.ego)
            timeline = Timeline(self.header.catalog, ego=track, car=car)
        signals = np.ascontiguousarray(self.steps["signals"])
        for frame, heads in zip(actor_frames(self.steps), signals, strict=True):
            timeline.append_step(frame, heads)
        return timeline

    def _log(self, prefix: str) -> ControlLog:
        return ControlLog(**{name: np.ascontiguousarray(self.ego[prefix + name]) for name in CONTROLS})


def _tracks(rows: NDArray[np.void]) -> tuple[EgoTrack, CarTrack]:
    """Spline, and wheels and pedals, of a car's rows."""
    # Here, since numba takes half a second to import.
    from carlaloc_env.timeline.ego_spline import EgoTrack

    switches = [rows[name] for name in ("throttle", "brake", "reverse", "handbrake")]
    car = CarTrack.from_arrays(
        rows["wheel_spin_radps"],
        rows["road_wheel_rad"],
        np.stack([np.asarray(column, dtype=np.float64) for column in switches], axis=-1),
    )
    return EgoTrack.from_arrays(rows["position_m"], rows["quat_xyzw"]), car


def _fixed(T_world_unit: Array, ticks: int) -> dict[str, Any]:
    """Spline, and wheels and pedals, of a unit that stands still."""
    from carlaloc_env.timeline.ego_spline import EgoTrack

    quat = matrix_to_quat(T_world_unit[:3, :3])
    position, attitude = (np.tile(values, (ticks, 1)) for values in (T_world_unit[:3, 3], quat))
    wheels = CarTrack.from_arrays(np.zeros((ticks, 4)), np.zeros(ticks), np.zeros((ticks, 4)))
    return {"ego": EgoTrack.from_arrays(position, attitude), "car": wheels}


def open_episode(path: str | Path) -> Episode:
    """Read an episode up to its first damage; `complete` and `problem` describe the rest.

    Raises:
        EpisodeError: the file is missing or foreign.
    """
    return Episode.load(path, allow_partial=True)


def episode_file(path: str | Path) -> Path:
    """The file of this name, or its recording where there is only that."""
    path = Path(path)
    recording = recording_path(path)
    return recording if not path.exists() and recording.exists() else path


def read_episode_file(path: Path) -> Container:
    """Records of an MCAP file.

    Raises:
        EpisodeError: the file is missing or not MCAP.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise EpisodeError(f"cannot read {path}: {error.strerror}; give an episode file (.mcap)") from error
    if not is_container(data):
        raise EpisodeError(f"{path} is no CarlaLoc episode: not an MCAP file; give another file")
    return read_container(data)


def _assemble(path: Path, header: EpisodeHeader, container: Container) -> Episode:
    payloads = container.payloads
    try:
        records = [ego_record(car) for car in range(len(header.cars) or 1)]
        egos = [record.rows(payloads.get(record.topic, [])) for record in records]
        steps = unpack_actors(payloads.get(ACTORS.topic, []), len(header.catalog))
        rows = [EVENT.unpack(payload) for payload in payloads.get(EVENT.topic, [])]
        events = tuple(Event(tick=r["tick"], kind=r["kind"], data=json.loads(r["json"])) for r in rows)
    except (ValueError, struct.error) as error:
        raise EpisodeError(f"{path} is damaged: {error}; give another file") from error
    ticks = min(map(len, egos))
    egos = [ego[:ticks] for ego in egos]
    for name, numbers in (*(("tick", ego["tick"]) for ego in egos), ("step", steps["step"])):
        gaps = np.flatnonzero(numbers != np.arange(len(numbers)))
        if len(gaps):
            raise EpisodeError(f"{path} is damaged: {name} {gaps[0]} is missing; give another file")
    return Episode(
        header, egos, steps, events, path=path, last_good_ns=container.last_good_ns, problem=container.problem
    )
