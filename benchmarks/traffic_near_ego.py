"""Traffic near the ego on its route, and the ego's progress: one row per town and seed.

``python -m benchmarks.traffic_near_ego Town03 Town05 Town10`` drives these routes among the paper's counts
with the scripted driver, ten times each. It prints the mean number of moving actors within 50 m and within
25 m. Single drives differ by a factor of two, because of queues at one light.
"""

import sys
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, TICK_HZ
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.scene.materials import Tag
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.population import traffic_of_town
from recorder.devices.scripted.driver import ScriptedDriver
from recorder.drive.listeners import RuleMonitor

TOWNS = ("Town03", "Town05", "Town10")
"""Towns whose routes are driven if none is named."""
SEEDS = range(10)
"""Seeds of the drives of each town."""
MOVES_MPS = 0.5
"""Slower actors wait [m/s]."""
STANDS_MPS = 0.3
"""A slower ego stands [m/s]."""
_SAME_LEVEL_M = 8.0
"""Actors farther above or below are on another road [m]."""
_PAST_NS = 2_000_000_000
"""How much of the past is kept [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NearTraffic:
    """Figures of a drive."""

    duration_s: float
    """Length of the drive [s]."""
    length_m: float
    """Distance along the route [m]."""
    moving_50: float
    """Mean number of actors within 50 m that move."""
    moving_25: float
    """The same within 25 m."""
    actors_50: float
    """Mean number of actors within 50 m, those that wait included."""
    walkers_50: float
    """Mean number of walkers within 50 m."""
    standing: float
    """Fraction of time for which the ego stood."""
    collisions: int
    """Ticks in which the ego touched somebody."""
    violations: tuple[str, ...]
    """Rules that it broke."""

    @property
    def speed_mps(self) -> float:
        """Mean speed of the ego, from the first tick to the last [m/s]."""
        return self.length_m / self.duration_s


def drive(town_name: str, seed: int = 0, duration_s: float = 600.0) -> NearTraffic:
    """Drive a town's route once, or until the time is over, and count who is near."""
    town = load_town(town_name)
    world, driver = DrivingWorld(town, traffic_of_town(town, "dynamic", seed)), ScriptedDriver(seed)
    rules = RuleMonitor(town.network)
    try:
        world.reset(seed)
        walker = world.timeline.catalog.tag == Tag.PEDESTRIAN
        rows, violations, collisions = [], [], 0
        end_m = world.route.length_m - (0.5 if world.route.closed else 3.0)
        while world.route_s_m < end_m and world.tick_count < duration_s * TICK_HZ:
            view = world.driver_view()
            contacts = world.tick(driver.read(view))
            collisions += any(contact.actor_id is not None for contact in contacts)
            if world.tick_count % STEP_TICKS == 0:
                violations += rules.update(world.driver_view())
                rows.append(_near(world, walker))
                world.forget_before(world.now_ns - _PAST_NS)
        length_m, seconds = world.route_s_m, world.tick_count / TICK_HZ
    finally:
        world.close()
    mean = np.mean(rows, axis=0)
    return NearTraffic(
        duration_s=seconds,
        length_m=length_m,
        moving_50=float(mean[0]),
        moving_25=float(mean[1]),
        actors_50=float(mean[2]),
        walkers_50=float(mean[3]),
        standing=float(mean[4]),
        collisions=collisions,
        violations=tuple(violations),
    )


def _near(world: DrivingWorld, walker: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> tuple[int, ...]:
    """Moving actors within 50 m and 25 m, all actors and walkers within 50 m, and whether the ego stands."""
    frame = world.timeline.actors_at(world.tick_count // STEP_TICKS * STEP_NS)
    away = frame.position_m - world.state.position_m
    distance_m = np.hypot(away[:, 0], away[:, 1])
    near = (distance_m < 50.0) & (np.abs(away[:, 2]) < _SAME_LEVEL_M)
    moving = near & (frame.speed_mps > MOVES_MPS)
    return (
        int(moving.sum()),
        int((moving & (distance_m < 25.0)).sum()),
        int(near.sum()),
        int((near & walker).sum()),
        int(world.state.speed_mps < STANDS_MPS),
    )


def _show(name: str, which: str, drives: list[NearTraffic]) -> None:
    """Print the means of some drives in one line."""
    seconds, length_m, standing, moving_50, moving_25, actors_50, walkers_50 = np.mean(
        [
            (r.duration_s, r.length_m, r.standing, r.moving_50, r.moving_25, r.actors_50, r.walkers_50)
            for r in drives
        ],
        axis=0,
    )
    violations = sorted({one for r in drives for one in r.violations})
    print(
        f"{name:8} {which:>4} {seconds:5.0f} {length_m:6.0f} {np.mean([r.speed_mps for r in drives]):5.1f} "
        f"{100 * standing:6.0f} % {moving_50:11.1f} {moving_25:5.1f} {actors_50:8.1f} {walkers_50:7.1f} "
        f"{sum(r.collisions for r in drives):10}  {', '.join(violations) or 'none'}",
        flush=True,
    )


if __name__ == "__main__":
    print(
        f"{'town':8} {'seed':>4} {'s':>5} {'m':>6} {'m/s':>5} {'standing':>8} {'moving 50 m':>11} "
        f"{'25 m':>5} {'all 50 m':>8} {'walkers':>7} {'collisions':>10}  violations"
    )
    for name in sys.argv[1:] or TOWNS:
        drives = []
        for number in SEEDS:
            drives.append(drive(name, number))
            _show(name, str(number), drives[-1:])
        _show(name, "mean", drives)
