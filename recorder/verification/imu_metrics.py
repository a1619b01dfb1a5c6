"""Metrics of an IMU on a car: how strong its readings are in bands of frequency, by the car's speed.

They need no calibration: gravity shows the vertical, and bends show the lateral axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import GRAVITY_MPS2, Array
from carlaloc_env.core.errors import EvaluationError

SPEEDS_MPS = ((4.0, 8.0), (16.0, 20.0))
"""Ranges of speed, of streets and of fast roads [m/s]."""
VERTICAL_HZ, LATERAL_HZ, ROLL_HZ = ((1, 3), (3, 8), (8, 15), (15, 25)), ((1, 3), (3, 8)), ((1, 3),)
"""Bands of the vertical and lateral acceleration and of the roll rate [Hz]."""
_SEGMENT_S, _STANDING_MPS, _BEND_S = 5.0, 0.05, 1.0
"""Length of a spectrum's segments [s], greatest speed at rest [m/s], and time that shows bends [s]."""
_BENDS = 0.3
"""Least correlation of sideways force and yaw rate by which bends show the lateral axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuLog:
    """An IMU's readings in its own axes, and the car's speed."""

    stamp_ns: NDArray[np.int64]
    """Times [ns], shape (N,)."""
    force_mps2: Array
    """Specific force [m/s²], shape (N, 3)."""
    rate_radps: Array
    """Rate of turning [rad/s], shape (N, 3)."""
    speed_mps: Array
    """Speed of the car [m/s], NaN where it is not known, shape (N,)."""


def imu_metrics(log: ImuLog) -> dict[str, float]:
    """Metrics by name; NaN where the car never had the speed for five seconds.

    Raises:
        EvaluationError: there are too few readings, or gravity is not among them.
    """
    steps = np.diff(log.stamp_ns)
    if len(steps) < 100 or not (period_s := float(np.median(steps)) * 1e-9) > 0:
        raise EvaluationError(f"an IMU has {len(log.stamp_ns)} readings; give some seconds of them")
    body = _body_axes(log, period_s)
    vertical, lateral = log.force_mps2 @ body[2], log.force_mps2 @ body[1]
    roll = log.rate_radps @ body[0]
    size = round(_SEGMENT_S / period_s)
    broken = np.concatenate([[False], np.abs(steps * 1e-9 - period_s) > 0.5 * period_s])
    metrics: dict[str, float] = {}
    for low, high in SPEEDS_MPS:
        begins = _segments((log.speed_mps >= low) & (log.speed_mps < high), broken, size)
        for name, signal, bands in (
            ("a_z", vertical, VERTICAL_HZ), ("a_y", lateral, LATERAL_HZ), ("roll rate", roll, ROLL_HZ)
        ):  # fmt: skip
            power = _spectrum(signal, begins, size, period_s)
            for band in bands:
                key = f"{name} {band[0]}-{band[1]} Hz at {low:g}-{high:g} m/s"
                metrics[key] = _in_band(power, band, size, period_s)
    rest = _segments(log.speed_mps < _STANDING_MPS, broken, size)
    still = [log.force_mps2[begin : begin + size].std(axis=0).mean() for begin in rest]
    metrics["acceleration at rest"] = float(np.median(still)) if still else float("nan")
    return metrics


def _body_axes(log: ImuLog, period_s: float) -> Array:
    """Forward, left and up in the IMU's axes, rows of a matrix (3, 3)."""
    mean = np.median(log.force_mps2, axis=0)
    size = float(np.sqrt(mean @ mean))
    if not 0.8 * GRAVITY_MPS2 < size < 1.2 * GRAVITY_MPS2:
        raise EvaluationError(
            f"an IMU's median force is {size:.2f} m/s²; give readings in m/s², with gravity"
        )
    up = mean / size
    span = max(round(_BEND_S / period_s), 1)
    rows = len(log.stamp_ns) // span * span
    force = log.force_mps2[:rows].reshape(-1, span, 3).mean(axis=1)
    yaw = (log.rate_radps[:rows] @ up).reshape(-1, span).mean(axis=1)
    force, yaw = force - force.mean(axis=0), yaw - yaw.mean()
    force -= np.outer(force @ up, up)
    left = yaw @ force
    spread = np.sqrt((yaw @ yaw) * (force * force).sum())
    if not np.sqrt(left @ left) > _BENDS * spread:
        # Straight roads show nothing: x is ahead, or z where x points up.
        left = np.cross(up, np.eye(3)[2 if abs(up[0]) > 0.7 else 0])
    left = left / np.sqrt(left @ left)
    return np.stack([np.cross(left, up), left, up])


def _segments(wanted: NDArray[np.bool_], broken: NDArray[np.bool_], size: int) -> list[int]:
    """First readings of half-overlapping segments that are wanted all over and without a gap."""
    count = len(wanted)
    # A gap ends a segment before its reading, and another may begin there.
    unwanted = np.maximum.accumulate(np.where(wanted, -1, np.arange(count)))
    gap = np.maximum.accumulate(np.where(broken, np.arange(count), 0))
    begins, at = [], 0
    while at + size <= count:
        end = at + size - 1
        clean = max(int(unwanted[end]) + 1, int(gap[end]))
        if clean <= at:
            begins.append(at)
        at = at + size // 2 if clean <= at else clean
    return begins


def _spectrum(signal: Array, begins: list[int], size: int, period_s: float) -> Array:
    """One-sided power spectral density, mean of Hann windows without their trends, shape (size // 2 + 1,)."""
    if not begins:
        return np.full(size // 2 + 1, np.nan)
    rows = signal[np.array(begins)[:, None] + np.arange(size)]
    line = np.linspace(-1.0, 1.0, size)
    rows = rows - rows.mean(axis=1, keepdims=True)
    rows = rows - np.outer(rows @ line / (line @ line), line)
    window = np.hanning(size)
    power: Array = (np.abs(np.fft.rfft(rows * window, axis=1)) ** 2).mean(axis=0)
    return 2.0 * period_s * power / (window @ window)


def _in_band(power: Array, band: tuple[int, int], size: int, period_s: float) -> float:
    """Root mean square in a band."""
    frequency = np.arange(len(power)) / (size * period_s)
    inside = (frequency >= band[0]) & (frequency < band[1])
    return float(np.sqrt(power[inside].sum() / (size * period_s))) if inside.any() else float("nan")
