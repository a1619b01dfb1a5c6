"""Sensors: LiDAR and camera compared with PyBullet's, LiDAR compared with Embree alone."""

import itertools
from dataclasses import replace

import numpy as np
from bench import ACTORS_IN_RANGE, Bench, Row, compared
from embree_alone import embree_alone
from numpy.typing import NDArray
from scenario import RANGE_M, drive_among
from timing import time_calls

from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.timeline import Timeline

CROWDED = 60


def lidar(bench: Bench) -> Row:
    """One revolution of the paper's LiDAR, both clouds with noise, against the bare rays in PyBullet."""
    config = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
    T = bench.drive.timeline.ego_motion([bench.drive.stamps_ns[0]]).T_world_frame[0]
    T = T @ config.mount.T_base_sensor
    azimuth = -2 * np.pi * np.arange(config.columns) / config.columns
    turn, lift = np.meshgrid(azimuth, np.radians(config.elevations_deg), indexing="ij")
    rays = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=-1)
    directions = rays.reshape(-1, 3) @ T[:3, :3].T
    naive = bench.naive_drive()
    times = time_calls(
        {
            "ours": bench.sweep(bench.sensor(LidarConfig)),
            "naive": lambda: naive.ranges_m(T[:3, 3], directions, config.range_max_m),
        },
        3 * bench.repeat,
    )
    return compared(
        "lidar",
        f"LiDAR scan of {len(directions)} rays, {ACTORS_IN_RANGE} moving actors in range",
        times,
        12.0,
        f"actors within {bench.drive.farthest_m:.0f} of {RANGE_M:.0f} m; "
        f"rayTestBatch over {naive.bodies} bodies",
    )


def lidar_rate(bench: Bench) -> Row:
    """A whole scan, both clouds, against Embree alone casting the same rays at everything held still."""
    drive = drive_among(bench.town, CROWDED, steps=5 if bench.quick else 100, sweeps=1 if bench.quick else 4)
    timeline = drive.timeline
    sensor = bench.sensor(LidarConfig)
    config = sensor.config
    assert isinstance(config, LidarConfig)
    sweeps = {stamp: _rays(config, timeline, stamp) for stamp in drive.stamps_ns}
    cast = embree_alone(bench.town.chunks, bench.stage.library, timeline, drive.stamps_ns[0])
    # Successive sweeps, as in a drive, so that no result of a sweep is reused.
    ours_next, alone_next = (itertools.cycle(drive.stamps_ns) for _ in range(2))
    times = time_calls(
        {
            "ours": lambda: sensor.measure(timeline, [next(ours_next)]),
            "embree": lambda: cast(sweeps[next(alone_next)]),
        },
        (1 if bench.quick else 12) * bench.repeat,
        warm_up=len(sweeps),
    )
    ours, embree = times["ours"], times["embree"]
    return Row(
        name="lidar_rate",
        what=f"LiDAR scan of {config.rays} rays, {CROWDED} actors; rate against bare Embree, still scene",
        # Open3D holds Python's lock while it casts, which costs by the clock alone.
        value=embree.cpu_s / ours.cpu_s,
        unit="of Embree's rate",
        target=0.5,
        ours=ours,
        note=f"actors within {drive.farthest_m:.0f} m; CPU times of {ours.calls} calls in turn",
        detail={
            "embree_ms": 1e3 * embree.least_s,
            "ours_ms": 1e3 * ours.least_s,
            "ratio_of_medians": embree.median_s / ours.median_s,
            "ratio_of_least": embree.least_s / ours.least_s,
        },
    )


def _rays(config: LidarConfig, timeline: Timeline, stamp_ns: int) -> NDArray[np.float32]:
    """Origins [m] and directions of all rays of a sweep, world, shape (N, 6)."""
    columns = stamp_ns + np.arange(config.columns) * config.sweep_ns // config.columns
    T = timeline.ego_motion(columns).at_mount(config.mount.T_base_sensor).T_world_frame
    azimuth = np.pi - 2 * np.pi * (np.arange(config.columns) + 0.5) / config.columns
    turn, lift = np.meshgrid(azimuth, np.radians(config.elevations_deg), indexing="ij")
    local = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=-1)
    directions = np.einsum("cij,cbj->cbi", T[:, :3, :3], local)
    origins = np.broadcast_to(T[:, None, :3, 3], directions.shape)
    return np.concatenate([origins, directions], axis=-1).reshape(-1, 6).astype(np.float32)


def camera(bench: Bench) -> Row:
    """Colour, depth and semantics of one camera."""
    config = next(c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig))
    # The paper's also fires events, which have a row of their own.
    config = replace(config, outputs=("rgb", "depth", "semantic"))
    T = bench.drive.timeline.ego_motion([bench.drive.stamps_ns[0]]).T_world_frame[0]
    T = T @ config.mount.T_base_sensor
    naive = bench.naive_drive()
    what = f"camera {config.pinhole.width_px}×{config.pinhole.height_px}: RGB, depth, semantics"
    try:
        ours = bench.sweep(config.build(bench.stage))
        ours()
    except CarlaLocError as error:
        return Row(name="camera", what=what, value=None, unit="× faster", target=3.0, note=str(error))
    calls = {"ours": ours, "naive": lambda: naive.picture(config.pinhole, T)}
    return compared("camera", what, time_calls(calls, bench.repeat), 3.0, "against TinyRenderer")
