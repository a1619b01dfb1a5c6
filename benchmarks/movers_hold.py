"""Localizability by LiDAR scans among traffic: `python benchmarks/movers_hold.py DRIVE.mcap [...]`.

Movers do two things to point-to-plane ICP, see `localizability`. They *hide* the things that stand still:
their points hold nothing and still count among the N. And they *pull*: since the scan before, Δt ago, a
surface with unit normal n and velocity v has moved by n·v Δt, and the least-squares shift follows it,

    H x = Σ Jᵢᵀ (nᵢ · vᵢ) / N,        x = (turn, shift) per second,

so that a lorry abreast drags the estimate along by its share of the information along the road. A match that
is farther off than a system's gate is no match; the gate here is 1 m at 20 sweeps a second.

Prints for each drive: localizability (least eigenvalue, returns from leaves constrain nothing) on an empty
road and among movers, the movers' share of the points, and the pull along the road.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from localizability import directions_past_the_car, is_loose, localizability

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array, Index, Mask
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.raycast import Hits, RayScene
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.ranging_config import LidarConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from carlaloc_env.weather.parameters import weather_by_name
from recorder.episode.episode import Episode
from recorder.episode.summary import town_of

GATE_M, SWEEP_S = 1.0, 0.05
"""Matches farther apart than this are left out [m], and time between scans [s]."""
_TILT_RAD = 1e-3
"""Turn between the three rays that give a mover's normal [rad]."""
_MOVES_MPS = 0.3


def pull_mps(points_m: Array, normals: Array, velocities_mps: Array) -> Array:
    """Shift per second that moving surfaces put into a least-squares match [m/s], shape (3,).

    Args:
        points_m: Points from the sensor, along any axes [m], shape (N, 3).
        normals: Unit normals of their surfaces, zeros where there is no plane, shape (N, 3).
        velocities_mps: Velocities of the surfaces over the ground [m/s], shape (N, 3).
    """
    jacobian = np.concatenate([np.cross(points_m, normals), normals], axis=1)
    along = np.einsum("ij,ij->i", normals, velocities_mps)
    matched = np.abs(along) * SWEEP_S <= GATE_M
    found: Array = np.linalg.lstsq(jacobian[matched], along[matched], rcond=1e-9)[0]
    return found[3:]


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldAmongMovers:
    """Measures of one scan among traffic."""

    at_rest: float
    """`Localizability.least` of firm returns on an empty road."""
    hidden: float
    """The same with movers in the way."""
    pull_mps: float
    """Pull along the car's axis [m/s], forwards positive."""
    share: float
    """Share of movers among all returns, 0–1."""


class DriveScans:
    """Scans along a drive, with normals and velocities of what they meet.

    Args:
        town: Where it was driven.
        timeline: The drive.
        lidar: The LiDAR with its mount; its noise is left out.
    """

    def __init__(self, town: Town, timeline: Timeline, lidar: LidarConfig) -> None:
        self._stage = SensorStage(town, seed=0, weather=weather_by_name("ClearNoon"))
        self._rays: RayScene = self._stage.rays()
        self._timeline, self._lidar, self._mount = timeline, lidar, lidar.mount.T_base_sensor
        # Every other ray is enough.
        self._directions = directions_past_the_car(self._stage, lidar)[::2]

    def close(self) -> None:
        """Free the town."""
        self._stage.close()

    def at(self, stamp_ns: int) -> HoldAmongMovers:
        """The scan of an instant [ns], as if it took no time."""
        motion = self._timeline.ego_motion(np.array([stamp_ns]))
        turn = transforms.quat_to_matrix(motion.quat_xyzw[0])
        origin = turn @ self._mount[:3, 3] + motion.position_m[0]
        aimed = self._directions @ turn.T
        town, normals = self._rays.surfaces(origin, aimed, self._lidar.range_max_m)
        planes = np.where(is_loose(town)[:, None], 0.0, normals)
        hits = self.cast(origin, aimed, stamp_ns)
        moved: Mask = hits.range_m < town.range_m - 1e-3
        own_planes, velocities = self.movers(origin, aimed, stamp_ns, hits, np.flatnonzero(moved))
        seen = np.isfinite(hits.range_m) & (hits.range_m >= self._lidar.range_min_m)
        alone = np.isfinite(town.range_m) & (town.range_m >= self._lidar.range_min_m)
        points = _points(aimed, hits)[seen]
        every = np.where(moved[:, None], own_planes, planes)[seen]
        return HoldAmongMovers(
            at_rest=localizability(_points(aimed, town)[alone], planes[alone]).least,
            hidden=localizability(points, np.where(moved[:, None], 0.0, planes)[seen]).least,
            pull_mps=float(pull_mps(points, every, velocities[seen]) @ turn[:, 0]),
            share=float((moved & (np.linalg.norm(velocities, axis=1) > _MOVES_MPS))[seen].mean()),
        )

    def cast(self, origin: Array, directions: Array, stamp_ns: int) -> Hits:
        """First hits of rays from one place [m] at an instant [ns], the car itself left out."""
        origins, stamps = np.broadcast_to(origin, directions.shape), np.full(len(directions), stamp_ns)
        return self._rays.cast(
            origins, directions, stamps, self._timeline, self._lidar.range_max_m, ego=False
        )

    def movers(
        self, origin: Array, aimed: Array, stamp_ns: int, hits: Hits, rows: Index
    ) -> tuple[Array, Array]:
        """Normals and velocities [m/s] of actors that some rays meet, zeros elsewhere, both (N, 3)."""
        normals, velocities = np.zeros((2, *aimed.shape))
        if not len(rows):
            return normals, velocities
        met = hits.take(rows)
        corners, same = [_points(aimed[rows], met)], np.ones(len(rows), bool)
        for tilted in _beside(aimed[rows]):
            other = self.cast(origin, tilted, stamp_ns)
            same &= other.instance == met.instance
            corners.append(_points(tilted, other))
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normals[rows] = np.where(same[:, None] & (length > 0), normal / np.maximum(length, 1e-12), 0.0)
        ids = self._timeline.catalog.id
        order = np.argsort(ids)
        actor = order[np.searchsorted(ids[order], met.instance)]
        now, later = (
            self._timeline.actor_poses(actor, np.full(len(actor), stamp))[0]
            for stamp in (stamp_ns, stamp_ns + STEP_NS)
        )
        velocities[rows] = (later - now) / (1e-9 * STEP_NS)
        return normals, velocities


def _points(directions: Array, hits: Hits) -> Array:
    """Points from the sensor [m], zeros where nothing was hit, shape (N, 3)."""
    reached: Array = directions * np.where(np.isfinite(hits.range_m), hits.range_m, 0.0)[:, None]
    return reached


def _beside(directions: Array) -> tuple[Array, Array]:
    """Directions turned a little to the left, and upwards."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    elevation = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))

    def aim(a: Array, e: Array) -> Array:
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)

    return aim(azimuth + _TILT_RAD, elevation), aim(azimuth, elevation + _TILT_RAD)


def main() -> None:
    """Measure the drives that were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("drives", nargs="+", type=Path, help="episodes")
    parser.add_argument("--every", type=float, default=2.0, help="time between scans [s]")
    parser.add_argument("--curve", action="store_true", help="print each scan")
    arguments = parser.parse_args()
    lidar = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
    print("drive        at rest   hidden: median  5 %     share   pull m/s: median   95 %")
    for drive in arguments.drives:
        episode = Episode.load(drive)
        timeline = episode.timeline()
        scans = DriveScans(town_of(episode), timeline, lidar)
        step = round(arguments.every * 1e9 / STEP_NS) * STEP_NS
        stamps = range(step, timeline.end_ns - STEP_NS, step)
        found = [scans.at(stamp) for stamp in stamps]
        scans.close()
        hidden, pull = (np.array([getattr(one, name) for one in found]) for name in ("hidden", "pull_mps"))
        print(
            f"{drive.stem:12} {np.median([one.at_rest for one in found]):7.4f} {np.median(hidden):16.4f}"
            f" {np.quantile(hidden, 0.05):7.4f} {np.mean([one.share for one in found]):8.3f}"
            f" {np.median(np.abs(pull)):18.2f} {np.quantile(np.abs(pull), 0.95):6.2f}"
        )
        if arguments.curve:
            for stamp, one in zip(stamps, found, strict=True):
                print(f"  {1e-9 * stamp:6.1f} s  {one.hidden:.4f}  {one.share:.3f}  {one.pull_mps:+.2f} m/s")


if __name__ == "__main__":
    main()
