"""Notes on a rig that is valid, yet perhaps not the one that was meant."""

from __future__ import annotations

from carlaloc_env.rigs.rig import SensorRig

_ANYWHERE = ("speed", "wheels")
"""Kinds of sensors that may lie at the origin of `base_link`."""


def rig_notes(rig: SensorRig) -> list[str]:
    """A line for each sensor on the road under the car, and one for LiDARs beside the first."""
    notes = [
        f"{sensor.kind} '{sensor.name}' sits at [0, 0, 0], on the road under the car; give its mount"
        for sensor in rig.sensors
        if sensor.mount.position_m == (0.0, 0.0, 0.0) and sensor.kind not in _ANYWHERE
    ]
    if len(lidars := rig.of_kind("lidar")) > 1:
        names = ", ".join(lidar.name for lidar in lidars)
        notes.append(
            f"{len(lidars)} LiDARs ({names}): systems read the first, unless --lidar names one; where a file "
            "extends a rig, an entry with the name of a sensor changes it, and one with another name adds one"
        )
    return notes
