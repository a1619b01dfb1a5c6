"""Pairs of frames that may show one place, with the exact overlap of both."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.raycast.scene import RayScene
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.timeline.timeline import Timeline
from recorder.laboratory.true_map import Field, Progress, look, seen_shares


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frames:
    """Frames of a drive at even distances along its path."""

    stamp_ns: NDArray[np.int64]
    """Times since the drive began [ns], shape (N,)."""
    distance_m: Array
    """Distance driven since its first position [m], shape (N,)."""
    T_world_sensor: Array
    """Poses of the sensor, shape (N, 4, 4)."""

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def write(self, path: Path) -> Path:
        """Write a CSV with a row for each frame."""
        quat = transforms.matrix_to_quat(self.T_world_sensor[:, :3, :3])
        rows = np.column_stack([self.distance_m, self.T_world_sensor[:, :3, 3], quat])
        names = ["frame", "stamp_ns", "distance_m", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
        body = [
            [number, stamp, *(f"{value:.6f}" for value in row)]
            for number, (stamp, row) in enumerate(zip(self.stamp_ns.tolist(), rows.tolist(), strict=True))
        ]
        return write_csv(path, names, body)


def frames_along(
    timeline: Timeline,
    sensor: SensorConfig,
    *,
    every_m: float,
    span_ns: tuple[int, int],
    offset_m: float = 0.0,
) -> Frames:
    """The first frame after each of some even distances along a drive; a car that waits gives none.

    Args:
        timeline: The drive.
        sensor: The sensor.
        every_m: Distance between frames [m].
        span_ns: First stamp and end, not included [ns].
        offset_m: Where the first frame lies after the start of the stretch [m].

    Raises:
        EvaluationError: the drive is too short for a frame.
    """
    # Sensors of 20 Hz measure on this grid; sweeps must end before the drive does.
    stamps = np.arange(
        -(-span_ns[0] // STEP_NS) * STEP_NS, min(span_ns[1], timeline.end_ns - STEP_NS), STEP_NS
    )
    if len(stamps) < 2:
        raise EvaluationError(f"a stretch of {len(stamps)} frames; give a longer one")
    motion = timeline.ego.motion(stamps)
    steps = np.sqrt(np.sum(np.diff(motion.position_m, axis=0) ** 2, axis=1))
    way = np.append(0.0, np.cumsum(steps))
    wanted = np.arange(offset_m, way[-1], every_m)
    rows = np.unique(np.searchsorted(way, wanted))
    if not len(rows):
        raise EvaluationError(f"a way of {way[-1]:.1f} m has no frame every {every_m:g} m; give a longer one")
    T = motion.T_world_frame[rows] @ sensor.mount.T_base_sensor
    return Frames(stamp_ns=stamps[rows], distance_m=way[rows], T_world_sensor=T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pairs:
    """Pairs of a query and a reference frame; all others overlap by 0 or lie too far apart."""

    query: Index
    """Number of the query's frame, shape (N,)."""
    reference: Index
    """Number of the reference's frame, shape (N,)."""
    distance_m: Array
    """Distance of both sensors [m], shape (N,)."""
    angle_deg: Array
    """Angle between both attitudes [deg], shape (N,)."""
    of_query: Array
    """Share of what the query shows that the reference sees, 0–1, shape (N,)."""
    of_reference: Array
    """Share of what the reference shows that the query sees, 0–1, shape (N,)."""

    @property
    def overlap(self) -> Array:
        """The smaller of both shares, 0–1, shape (N,)."""
        return np.minimum(self.of_query, self.of_reference)

    def matrix(self, queries: int, references: int) -> Array:
        """Overlap of all frames with all, 0 where there is no pair, shape (queries, references)."""
        entries = (self.overlap, (self.query, self.reference))
        return np.asarray(coo_matrix(entries, (queries, references)).toarray())

    def write(self, path: Path) -> Path:
        """Write a CSV with a row for each pair."""
        names = ["query", "reference", "distance_m", "angle_deg", "of_query", "of_reference", "overlap"]
        values = (self.distance_m, self.angle_deg, self.of_query, self.of_reference, self.overlap)
        numbers = zip(self.query.tolist(), self.reference.tolist(), strict=True)
        rows = np.column_stack(values).tolist()
        body = [[*pair, *(f"{v:.4f}" for v in row)] for pair, row in zip(numbers, rows, strict=True)]
        return write_csv(path, names, body)


def find_pairs(
    rays: RayScene,
    field: Field,
    query: Frames,
    reference: Frames,
    *,
    within_m: float,
    other: Field | None = None,
    count: int = 1000,
    report: Progress = lambda *_: None,
) -> Pairs:
    """All pairs of frames whose sensors lie within a distance, and their overlap.

    Args:
        rays: The town that both were driven in.
        field: Field of the sensor.
        query: Frames that look for their place.
        reference: Frames of the known drive.
        within_m: Longest distance between both [m].
        other: Field of the reference's sensor; None: the same.
        count: About how many rays each frame casts; a share has an error of at most 0.5/√count (1 σ).
        report: Called at each frame.
    """
    places = [frames.T_world_sensor[:, :3, 3] for frames in (query, reference)]
    near = cKDTree(places[0]).sparse_distance_matrix(cKDTree(places[1]), within_m, output_type="ndarray")
    near = np.sort(near, order=["i", "j"])
    i, j = near["i"].astype(np.intp), near["j"].astype(np.intp)
    total = 2 * (len(query) + len(reference))
    views, fields = [], (field, other or field)
    for frames, of_frames in zip((query, reference), fields, strict=True):
        views.append([look(rays, of_frames, T, count) for T in frames.T_world_sensor])
        report(sum(map(len, views)), total)
    shares = np.zeros((2, len(i)))
    for side, (eyes, shown, eye, of_shown) in enumerate(
        ((views[1], views[0], j, i), (views[0], views[1], i, j))
    ):
        for number, view in enumerate(eyes):
            rows = np.flatnonzero(eye == number)
            if len(rows):
                known = [shown[k] for k in of_shown[rows]]
                shares[side, rows] = seen_shares(rays, fields[1 - side], view, known)
        report(total // 2 * (side + 2) / 2, total)
    turn = np.einsum("nij,nij->n", query.T_world_sensor[i, :3, :3], reference.T_world_sensor[j, :3, :3])
    return Pairs(
        query=i,
        reference=j,
        distance_m=near["v"],
        angle_deg=np.degrees(np.arccos(np.clip(0.5 * (turn - 1.0), -1.0, 1.0))),
        of_query=shares[0],
        of_reference=shares[1],
    )


def write_csv(path: Path, names: list[str], rows: list[list[object]]) -> Path:
    """Write a table, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    with atomic_write(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(names)
        table.writerows(rows)
    return path
