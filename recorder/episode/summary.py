"""Figures of an episode: distance, duration, closure of the loop, actors."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.transforms import quat_to_rpy, wrap_angle
from carlaloc_env.scene.materials import Tag
from recorder.episode.episode import Episode
from recorder.episode.messages import VIOLATIONS

LOOP_CLOSED_M = 5.0
"""Ends nearer than this close a loop [m]."""
TABLE_FRACTION = 0.01
"""How far the length may be from the paper's Table III, as a fraction of it."""
LOOP_CLOSED_DEG = 10.0
"""Ends whose headings differ by less close a loop [deg]."""


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
    vehicles: int
    """Vehicles in the traffic."""
    walkers: int
    """Walkers in the traffic."""
    collisions: int
    """Collisions of the ego."""
    violations: dict[str, int]
    """How often each rule was broken."""
    table_length_m: float | None
    """Length that the paper's Table III gives for this town's route [m], None where it gives none."""
    meets_table: bool | None
    """Whether the distance driven (within 1 %) and loop are as the table says; None where it gives none."""
    complete: bool
    """Whether the file is whole."""
    health: str
    """``complete``, or what is wrong and until when the file is good."""


def driven_distance_m(episode: Episode) -> float:
    """Distance that the ego has driven [m], summed over ticks in the plane."""
    steps = np.diff(episode.ego["position_m"][:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def _route_distance_m(episode: Episode) -> float | None:
    ends = [event.data["route_m"] for event in episode.events if event.kind == "end"]
    last = None if episode.header.history or not ends else ends[-1]
    return float(last) if isinstance(last, (int, float)) else None


def summarise(episode: Episode) -> EpisodeSummary:
    """Figures of an episode."""
    position = episode.ego["position_m"]
    driven_m = driven_distance_m(episode)
    closure_m = closure_deg = None
    closed = False
    if len(position):
        closure_m = float(np.linalg.norm(position[-1] - position[0]))
        yaw = quat_to_rpy(episode.ego["quat_xyzw"][[0, -1]])[:, 2]
        closure_deg = float(np.degrees(abs(wrap_angle(yaw[1] - yaw[0]))))
        closed = driven_m > 50.0 and closure_m < LOOP_CLOSED_M and closure_deg < LOOP_CLOSED_DEG
    walkers = int(np.count_nonzero(episode.header.catalog.tag == Tag.PEDESTRIAN))
    table_m = episode.header.route.get("table_length_m")
    loop = bool(episode.header.route.get("closed"))
    counts = Counter(event.kind for event in episode.events)
    meets = None
    if table_m is not None:
        meets = abs(driven_m - table_m) <= TABLE_FRACTION * table_m and (closed or not loop)
    good_until = f"good until {episode.last_good_ns / 1e9:.3f} s"
    return EpisodeSummary(
        path=str(episode.path),
        map=episode.header.map_name,
        town_hash=episode.header.town_hash,
        device=episode.header.device,
        seed=episode.header.seed,
        duration_s=episode.duration_s,
        driven_m=driven_m,
        route_m=_route_distance_m(episode),
        closure_m=closure_m,
        closure_deg=closure_deg,
        loop_closed=closed,
        vehicles=len(episode.header.catalog) - walkers,
        walkers=walkers,
        collisions=counts["collision"],
        violations={kind: counts[kind] for kind in VIOLATIONS if counts[kind]},
        table_length_m=table_m,
        meets_table=meets,
        complete=episode.complete,
        health="complete" if episode.complete else f"{episode.problem}; {good_until}",
    )
