"""What the window draws: the present of a driving world, and what the driver has switched on."""

from __future__ import annotations

from dataclasses import replace

from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.timeline.timeline import LIGHT_LEFT, LIGHT_RIGHT, Snapshot, is_blink
from recorder.window.status import DriveStatus

VIEWS = ("seat", "chase", "above")
"""Cameras in the order in which the driver switches through them."""
_INDICATORS = {"left": LIGHT_LEFT, "right": LIGHT_RIGHT}


def present_of(world: DrivingWorld, status: DriveStatus) -> Snapshot:
    """The present of a world, with the ego's indicators and headlamps as its driver has switched them."""
    snapshot = Snapshot.of(world.timeline, world.now_ns)
    indicator = _INDICATORS.get(status.indicator, 0) if is_blink(snapshot.stamp_ns) else 0
    return replace(snapshot, ego_lights=snapshot.ego_lights | indicator, ego_headlamps=status.headlamps)
