"""Event pixels without a camera: uniform thresholds, states without history, a wall that moves."""

from typing import Any

import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation
from carlaloc_env.sensors.event_camera.esim import generate_events
from carlaloc_env.sensors.event_camera.pixels import NEVER_US, NoiseEvents, PixelState, Thresholds
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion, passing_surfaces
from carlaloc_env.sensors.imaging.motion_field import ScenePoses, motion_field

SHAPE = (32, 48)
SPAN_US = 50_000
PINHOLE = Pinhole(width_px=192, height_px=96, fx_px=120.0, fy_px=120.0, cx_px=96.0, cy_px=48.0)


def uniform(on: float, off: float, shape: tuple[int, int] = SHAPE) -> Thresholds:
    return Thresholds(on=np.full(shape, on, np.float32), off=np.full(shape, off, np.float32))


def fresh(level: F32) -> PixelState:
    return PixelState(reference=level.copy(), last_us=np.full(level.shape, NEVER_US, np.int32))


def run(before: F32, after: F32, motion: FrameMotion | None = None, **changes: Any) -> tuple[Any, PixelState]:
    settings: dict[str, Any] = {
        "state": fresh(before),
        "thresholds": uniform(0.2, 0.2, before.shape),
        "noise": NoiseEvents.draw(1, "x", 0, before.shape, 0.0, SPAN_US),
        "start_ns": 0,
        "span_us": SPAN_US,
        "refractory_us": 0,
        "leak_hz": 0.0,
        **changes,
    }
    state, thresholds, noise = (settings.pop(name) for name in ("state", "thresholds", "noise"))
    return generate_events(before, after, motion, state, thresholds, noise, **settings)


def sums(events: Any, shape: tuple[int, int], on: Any, off: Any) -> F32:
    """Change of log intensity that the events of each pixel tell."""
    total = np.zeros(shape)
    np.add.at(total, (events["y"], events["x"]), np.where(events["p"] == 1, on, -np.asarray(off)))
    return total.astype(np.float32)


def plane_motion(speed_mps: float, depth_m: float, ahead: bool = False) -> tuple[FrameMotion, float]:
    """A wall across the view while the camera moves sideways (or ahead) for 50 ms; its motion [px]."""
    T = from_rotation(R_FLU_OPTICAL, (0.0, 0.0, 1.6))
    then = T.copy()
    then[0 if ahead else 1, 3] += speed_mps * 0.05
    none = {"actor_id": np.zeros(0, np.uint32), "T_world_actor": np.zeros((0, 4, 4))}
    instants = [
        ScenePoses(stamp_ns=k * 50_000_000, T_world_camera=pose, **none) for k, pose in enumerate((T, then))
    ]
    shape = (PINHOLE.height_px, PINHOLE.width_px)
    ids = np.zeros(shape, np.uint32)
    now = np.full(shape, depth_m, np.float32)
    later = now - np.float32(speed_mps * 0.05 if ahead else 0.0)
    forward = motion_field(PINHOLE, now, ids, *instants)
    backward = motion_field(PINHOLE, later, ids, *instants[::-1])
    motion = FrameMotion(forward=forward, backward=backward, passing=passing_surfaces(forward))
    return motion, PINHOLE.fx_px * speed_mps * 0.05 / depth_m
