"""Images that cameras must see before a stretch, for the state of event pixels and exposure control."""

from __future__ import annotations

from carlaloc_env.core.clock import STEP_NS, TICK_NS, Schedule, stamp_ns
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig


def first_pictures_ns(
    rig: SensorRig, camera_ns: tuple[int, int], span_ns: tuple[int, int]
) -> dict[CameraConfig, int]:
    """Stamp of each camera's first picture in a stretch [ns], of those with a picture there.

    Args:
        rig: The sensors.
        camera_ns: When cameras take pictures, end not included [ns].
        span_ns: The stretch, end not included [ns].
    """
    first_ns = {}
    begin_ns, end_ns = max(camera_ns[0], span_ns[0]), min(camera_ns[1], span_ns[1])
    for config in rig.sensors:
        if isinstance(config, CameraConfig):
            ticks = Schedule.from_hz(config.rate_hz).ticks_in(-(-begin_ns // TICK_NS), -(-end_ns // TICK_NS))
            if ticks:
                first_ns[config] = stamp_ns(ticks[0])
    return first_ns


def past_ns(rig: SensorRig, camera_ns: tuple[int, int], span_ns: tuple[int, int]) -> tuple[int, int]:
    """Begin and end of the images that cameras must see before a stretch [ns]; equal if there are none.

    Takes the arguments of `first_pictures_ns`.
    """
    firsts = first_pictures_ns(rig, camera_ns, span_ns)
    begin_ns = min((config.remembers_from_ns(ns) for config, ns in firsts.items()), default=span_ns[0])
    return begin_ns, max(firsts.values(), default=span_ns[0])


def past_s(rig: SensorRig, camera_ns: tuple[int, int], span_ns: tuple[int, int]) -> float:
    """Length of `past_ns` [s]. Takes the arguments of `first_pictures_ns`."""
    begin_ns, end_ns = past_ns(rig, camera_ns, span_ns)
    return (end_ns - begin_ns) / 1e9


def nearest_begin_ns(rig: SensorRig, camera_ns: tuple[int, int]) -> int | None:
    """The nearest begin of pictures that needs at most a step of earlier images [ns], or None.

    Args:
        rig: The sensors.
        camera_ns: When cameras shall take pictures, end not included [ns].
    """
    begin_ns, end_ns = camera_ns
    reach_ns = round(1e9 * past_s(rig, camera_ns, camera_ns))
    others = range(max(begin_ns - reach_ns, 0), min(begin_ns + reach_ns, end_ns), STEP_NS)
    short = [ns for ns in others if past_s(rig, (ns, end_ns), (ns, end_ns)) <= STEP_NS / 1e9]
    return min(short, key=lambda ns: abs(ns - begin_ns), default=None)
