"""Figures of an episode: distance, duration, closure of the loop, actors."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import ActorFrame
from recorder.episode.actor_messages import actor_states
from recorder.episode.ego_messages import VIOLATIONS
from recorder.episode.episode import Episode

LOOP_CLOSED_M = 5.0
"""Ends nearer than this close a loop [m]."""
TABLE_FRACTION = 0.01
"""How far the length may be from the paper's Table III, as a fraction of it."""
LOOP_CLOSED_DEG = 10.0
"""Ends whose headings differ by less close a loop [deg]."""
STANDS_MPS, GOES_MPS = 0.3, 1.0
"""Speeds below which the ego stands, and above which it drives: to stand again is another stop [m/s]."""
CLOSE_M = 10.0
"""A mover whose rear is within so much ahead of the front bumper is close [m]."""
_SAME_LEVEL_M = 3.0
"""Who is farther above or below is on another road [m]."""
_PART = 4096
"""Steps that are looked at together, so that memory suffices for drives of hours."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeSummary:
    """Figures of a drive."""

    path: str
    """File."""
    map: str
    """Town."""
    town_hash: str
    """Hash of the town as it was built."""
    device: str
    """Who drove."""
    ride: str
    """How the body answered to the road."""
    seed: int
    """Seed of traffic and noise."""
    duration_s: float
    """Length in time [s]."""
    driven_m: float
    """Distance driven [m], summed over ticks in the plane."""
    route_m: float | None
    """Distance along the route [m]; None where the file does not have it: it is edited or cut off."""
    closure_m: float | None
    """Distance between first and last position [m]; None where nothing was driven."""
    closure_deg: float | None
    """Difference between first and last heading [deg]; None where nothing was driven."""
    loop_closed: bool
    """Whether the drive ends where it began, after more than 50 m."""
    cars: tuple[dict[str, float | str], ...]
    """Of every car, where several are driven: ``device``, ``driven_m`` and ``collisions``."""
    vehicles: int
    """Vehicles in the traffic."""
    walkers: int
    """Walkers in the traffic."""
    standing: float
    """Fraction of the time for which the ego stands, 0–1."""
    stops: int
    """How often it came to stand."""
    mover_close_s: float
    """How long somebody who can move was less than `CLOSE_M` ahead, in the car's own width [s]."""
    collisions: int
    """Collisions of the ego."""
    violations: dict[str, int]
    """How often each rule was broken."""
    table_length_m: float | None
    """Length that the paper's Table III gives for this town's route [m], None where it gives none."""
    meets_table: bool | None
    """Whether the distance driven (within 1 %) and loop are as the table says; None where it gives none, and
    for drives by other than the scripted driver, who may take another way."""
    complete: bool
    """Whether the file is whole."""
    health: str
    """``complete``, or what is wrong and until when the file is good."""


def collision_count(episode: Episode) -> int:
    """Number of collisions of the ego.

    A car that is pushed against one wall touches it again and again: that is one.
    """
    return sum(event.kind == "collision" and not event.data.get("again") for event in episode.events)


def driven_distance_m(episode: Episode) -> float:
    """Distance that the ego has driven [m], summed over ticks in the plane."""
    steps = np.diff(episode.ego["position_m"][:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def _route_distance_m(episode: Episode) -> float | None:
    ends = [event.data["route_m"] for event in episode.events if event.kind == "end"]
    last = None if episode.header.history or not ends else ends[-1]
    return float(last) if isinstance(last, (int, float)) else None


def _standing(episode: Episode) -> tuple[float, int]:
    """Fraction of the time for which the ego stands, and how often it came to stand."""
    speed_mps = np.abs(episode.ego["speed_mps"])
    stands = speed_mps < STANDS_MPS
    clear = stands[stands | (speed_mps > GOES_MPS)]
    return float(stands.mean()) if len(stands) else 0.0, int(np.count_nonzero(clear[1:] & ~clear[:-1]))


def _mover_close_s(episode: Episode) -> float:
    """Time with a mover close ahead [s]."""
    size_m, steps = episode.header.catalog.size_m, episode.steps if len(episode.ego) else episode.steps[:0]
    parts = (slice(first, first + _PART) for first in range(0, len(steps), _PART))
    close = sum(_is_close(episode.ego_at_steps[p], actor_states(steps[p]), size_m).sum() for p in parts)
    return float(close) * STEP_TICKS * TICK_S


def _is_close(ego: NDArray[np.void], others: ActorFrame, size_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether a mover is close ahead at each of K steps, (K,); sizes of the N actors [m], (N, 3)."""
    heading = _yaw_rad(ego["quat_xyzw"])[:, None]
    away = others.position_m - ego["position_m"][:, None]
    cos, sin = np.cos(heading), np.sin(heading)
    along, across = np.abs(np.cos(others.heading_rad - heading)), np.abs(np.sin(others.heading_rad - heading))
    length, width = 0.5 * size_m[:, 0], 0.5 * size_m[:, 1]
    gap = away[..., 0] * cos + away[..., 1] * sin - length * along - width * across - EGO_FRONT_M
    beside = np.abs(away[..., 1] * cos - away[..., 0] * sin) - length * across - width * along
    near = (gap > 0.0) & (gap < CLOSE_M) & (np.abs(away[..., 2]) < _SAME_LEVEL_M)
    close: NDArray[np.bool_] = (near & (beside < 0.5 * EGO_SIZE_M[1])).any(axis=1)
    return close


def _yaw_rad(quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Yaw of attitudes (N, 4), without the half second that the compiled functions of `transforms` take."""
    x, y, z, w = quat_xyzw.T
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def summarise(episode: Episode) -> EpisodeSummary:
    """Figures of an episode."""
    position = episode.ego["position_m"]
    driven_m = driven_distance_m(episode)
    closure_m = closure_deg = None
    closed = False
    if len(position):
        closure_m = float(np.linalg.norm(position[-1] - position[0]))
        yaw = _yaw_rad(episode.ego["quat_xyzw"][[0, -1]])
        closure_deg = float(np.degrees(abs(wrap_angle(yaw[1] - yaw[0]))))
        closed = driven_m > 50.0 and closure_m < LOOP_CLOSED_M and closure_deg < LOOP_CLOSED_DEG
    standing, stops = _standing(episode)
    walkers = int(np.count_nonzero(episode.header.catalog.tag == Tag.PEDESTRIAN))
    table_m = episode.header.route.get("table_length_m")
    loop = bool(episode.header.route.get("closed"))
    counts = Counter(event.kind for event in episode.events)
    meets = None
    if table_m is not None and episode.header.device == "scripted":
        meets = abs(driven_m - table_m) <= TABLE_FRACTION * table_m and (closed or not loop)
    good_until = f"good until {episode.last_good_ns / 1e9:.3f} s"
    return EpisodeSummary(
        path=str(episode.path),
        map=episode.header.map_name,
        town_hash=episode.header.town_hash,
        device=episode.header.device,
        ride=episode.header.ride,
        seed=episode.header.seed,
        duration_s=episode.duration_s,
        driven_m=driven_m,
        route_m=_route_distance_m(episode),
        closure_m=closure_m,
        closure_deg=closure_deg,
        loop_closed=closed,
        cars=tuple(
            {
                "device": drive.header.device,
                "driven_m": driven_distance_m(drive),
                "collisions": collision_count(drive),
            }
            for drive in map(episode.of_car, range(1, len(episode.egos) + 1))
            if len(episode.egos) > 1
        ),
        vehicles=len(episode.header.catalog) - walkers,
        walkers=walkers,
        standing=standing,
        stops=stops,
        mover_close_s=_mover_close_s(episode),
        collisions=collision_count(episode),
        violations={kind: counts[kind] for kind in VIOLATIONS if counts[kind]},
        table_length_m=table_m,
        meets_table=meets,
        complete=episode.complete,
        health="complete" if episode.complete else f"{episode.problem}; {good_until}",
    )
