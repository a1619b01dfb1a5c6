"""Beams of the LiDARs that have a name."""

from __future__ import annotations

PAPER_ELEVATIONS_DEG: tuple[float, ...] = tuple(round(-30.0 + 40.0 * i / 31, 9) for i in range(32))
"""32 beams evenly from −30° to +10°, as CARLA's LiDAR spaces them [deg]."""
HDL32E_ELEVATIONS_DEG: tuple[float, ...] = (
    -30.67, -29.33, -28.0, -26.67, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0, -14.67,
    -13.33, -12.0, -10.67, -9.33, -8.0, -6.67, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67, 4.0, 5.33,
    6.67, 8.0, 9.33, 10.67,
)  # fmt: skip
"""Beams of the Velodyne HDL-32E [deg]; user manual, page 13."""
HDL32E_FIRING_NS: tuple[int, ...] = tuple(1152 * (2 * r if r < 16 else 2 * (r - 16) + 1) for r in range(32))
"""When each beam of the HDL-32E fires in its 46.08 µs cycle [ns]: lower and upper bank in turn."""
