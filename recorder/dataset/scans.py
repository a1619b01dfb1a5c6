"""Point clouds of bags, as LiDAR odometry systems take them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.geometry.transforms import matrix_to_quat
from recorder.dataset.bags import messages, stamp_ns, topics_in
from recorder.evaluation.trajectory import Trajectory

Progress = Callable[[int, int], None]
"""Called with scans done and scans in all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """One point cloud as a LiDAR odometry takes it."""

    stamp_ns: int
    """Unix time of the first point [ns]."""
    points_xyz_m: NDArray[np.float64]
    """Points in the sensor frame [m], shape (N, 3)."""
    time_s: NDArray[np.float64]
    """Time of each point after `stamp_ns` [s], shape (N,)."""
    ring: NDArray[np.int64] | None = None
    """Beam of each point, from below, shape (N,)."""
    intensity: NDArray[np.float64] | None = None
    """Intensity, shape (N,)."""
    tag: NDArray[np.uint8] | None = None
    """Semantic tag of each point, where the cloud is labelled, shape (N,)."""

    def take(self, rows: NDArray[np.bool_]) -> Scan:
        """Some of the points."""

        def part(values: Any) -> Any:
            return None if values is None else values[rows]

        return replace(
            self,
            points_xyz_m=self.points_xyz_m[rows],
            time_s=self.time_s[rows],
            ring=part(self.ring),
            intensity=part(self.intensity),
            tag=part(self.tag),
        )


class ScanSource(Protocol):
    """What gives sweeps: a sequence of a dataset, or a topic of a bag."""

    def scans(self) -> Iterator[Scan]:
        """All sweeps."""


def read_scans(bag: Path, topic: str) -> Iterator[tuple[int, Scan]]:
    """Point clouds of a topic, each with the number of all.

    Raises:
        EvaluationError: the bag is missing or damaged, or a cloud lacks x, y, z or time.
    """
    count = topics_in(bag).get(topic, 0)
    for message in messages(bag, topic):
        try:
            scan = _scan(message)
        except (ValueError, IndexError, AttributeError) as error:
            raise EvaluationError(
                f"cannot read {bag}: a damaged point cloud on {topic}; give another"
            ) from error
        yield count, scan


def sweep_of(bag: Path, topic: str) -> float:
    """Length of a sweep [s]: the time between the first two scans of a topic.

    Raises:
        EvaluationError: the bag is damaged or has less than two scans on the topic.
    """
    stamps = [scan.stamp_ns for _, (_, scan) in zip(range(2), read_scans(bag, topic), strict=False)]
    if len(stamps) < 2:
        raise EvaluationError(f"{bag} has no two point clouds on {topic}; name another topic or a longer bag")
    return (stamps[1] - stamps[0]) / 1e9


def _scan(message: Any) -> Scan:
    offset = {field.name: field.offset for field in message.fields}
    missing = [name for name in ("x", "y", "z", "time") if name not in offset]
    if missing:
        raise EvaluationError(
            f"a point cloud has no field {', '.join(missing)}; give clouds with x, y, z, time"
        )
    data = np.asarray(message.data).reshape(-1, message.point_step)
    column = {name: _float32(data, offset[name]) for name in ("x", "y", "z", "time")}
    ring = data[:, offset["ring"] : offset["ring"] + 2] if "ring" in offset else None
    return Scan(
        stamp_ns=stamp_ns(message),
        points_xyz_m=np.stack([column["x"], column["y"], column["z"]], axis=-1),
        time_s=column["time"],
        ring=None if ring is None else np.ascontiguousarray(ring).view("<u2")[:, 0].astype(np.int64),
        intensity=_float32(data, offset["intensity"]) if "intensity" in offset else None,
        tag=data[:, offset["label"]].copy() if "label" in offset else None,
    )


def _float32(data: NDArray[np.uint8], offset: int) -> NDArray[np.float64]:
    """One float32 field of all points, as float64."""
    return np.ascontiguousarray(data[:, offset : offset + 4]).view("<f4")[:, 0].astype(np.float64)


def trajectory_of(
    stamps_ns: list[int], poses: list[NDArray[np.float64]], name: str, bag: Path, topic: str
) -> Trajectory:
    """Trajectory of poses (4, 4) at Unix times [ns].

    Raises:
        EvaluationError: there is no pose.
    """
    if not poses:
        raise EvaluationError(f"{bag} has no point clouds on {topic}; name another topic")
    T = np.stack(poses)
    return Trajectory(
        stamp_ns=np.array(stamps_ns, np.int64),
        position_m=T[:, :3, 3].copy(),
        quat_xyzw=matrix_to_quat(T[:, :3, :3]),
        name=name,
    )
