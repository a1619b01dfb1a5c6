"""Actor states in fixed point: what a sensor sees live is what an episode holds, in half the bytes.

The steps lie far below every sensor's noise: 0.5 mm, 0.1 mrad (0.2 mm at a bumper), 4 mm/s.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.timeline.actors import ActorFrame

POSITION_STEP_M = 2.0**-11
"""Step of positions [m]."""
ANGLE_STEP_RAD = 2.0 * pi / 65536.0
"""Step of headings, slopes and wheel angles [rad]."""
SPEED_STEP_MPS = 2.0**-8
"""Step of speeds [m/s]."""
TRAVEL_STEP_M = 2.0**-8
"""Step of distances covered [m]."""
_INT16_MAX = 32767


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActorCodes:
    """State of N actors in whole steps; leading axes (e.g. of time) may come before N."""

    position: NDArray[np.int32]
    """Position in `POSITION_STEP_M`, shape (…, N, 3)."""
    heading: NDArray[np.int16]
    """Heading in `ANGLE_STEP_RAD`, shape (…, N)."""
    pitch: NDArray[np.int16]
    """Slope in `ANGLE_STEP_RAD`, shape (…, N)."""
    speed: NDArray[np.int16]
    """Speed in `SPEED_STEP_MPS`, shape (…, N)."""
    travelled: NDArray[np.int32]
    """Distance covered in `TRAVEL_STEP_M`, shape (…, N)."""
    steer: NDArray[np.int16]
    """Angle of the front wheels in `ANGLE_STEP_RAD`, shape (…, N)."""
    lights: NDArray[np.uint8]
    """Bits of lit lights, shape (…, N)."""
    roll: NDArray[np.int16]
    """Lean in `ANGLE_STEP_RAD`, shape (…, N)."""


def encode_actors(frame: ActorFrame) -> ActorCodes:
    """Nearest whole steps of a state."""
    return ActorCodes(
        position=_steps(frame.position_m, POSITION_STEP_M).astype(np.int32),
        heading=_angles(frame.heading_rad),
        pitch=_angles(frame.pitch_rad),
        speed=np.clip(_steps(frame.speed_mps, SPEED_STEP_MPS), -_INT16_MAX, _INT16_MAX).astype(np.int16),
        travelled=_steps(frame.travelled_m, TRAVEL_STEP_M).astype(np.int32),
        steer=_angles(frame.steer_rad),
        lights=frame.lights,
        roll=_angles(frame.roll_rad),
    )


def decode_actors(codes: ActorCodes) -> ActorFrame:
    """State of whole steps; `encode_actors` of it gives the same codes."""
    return ActorFrame(
        position_m=_values(codes.position, POSITION_STEP_M),
        heading_rad=_values(codes.heading, ANGLE_STEP_RAD),
        pitch_rad=_values(codes.pitch, ANGLE_STEP_RAD),
        speed_mps=_values(codes.speed, SPEED_STEP_MPS),
        travelled_m=_values(codes.travelled, TRAVEL_STEP_M),
        steer_rad=_values(codes.steer, ANGLE_STEP_RAD),
        lights=codes.lights,
        roll_rad=_values(codes.roll, ANGLE_STEP_RAD),
    )


def on_grid(frame: ActorFrame) -> ActorFrame:
    """The same state rounded to whole steps: `decode_actors` of its `encode_actors`."""
    rounded = {name: np.array(getattr(frame, name), order="C") for name in _ROUNDED}
    _rounding()(*rounded.values())
    return ActorFrame(**rounded, lights=frame.lights)


_ROUNDED = ("position_m", "travelled_m", "speed_mps", "heading_rad", "pitch_rad", "roll_rad", "steer_rad")


@functools.cache
def _rounding() -> Callable[..., None]:
    # Here, since numba takes half a second to import, and recorded states are read without it.
    from carlaloc_env.core.jit import compiled

    return compiled(_round)


def _round(
    position_m: F32, travelled_m: F32, speed_mps: F32, heading: F32, pitch: F32, roll: F32, steer: F32
) -> None:
    """Round N actors to whole steps; 0 is added since codes have no −0. Angles become −π up to below π."""
    for n in range(len(speed_mps)):
        for axis in range(3):
            position_m[n, axis] = np.rint(position_m[n, axis] / POSITION_STEP_M) * POSITION_STEP_M + 0.0
        travelled_m[n] = np.rint(travelled_m[n] / TRAVEL_STEP_M) * TRAVEL_STEP_M + 0.0
        steps = min(max(np.rint(speed_mps[n] / SPEED_STEP_MPS), -_INT16_MAX), _INT16_MAX)
        speed_mps[n] = steps * SPEED_STEP_MPS + 0.0
        for angle_rad in (heading, pitch, roll, steer):
            code = (int(np.rint(angle_rad[n] / ANGLE_STEP_RAD)) + 32768) % 65536 - 32768
            angle_rad[n] = float(code) * ANGLE_STEP_RAD


def _steps(values: NDArray[np.float32], step: float) -> NDArray[np.float64]:
    rounded: NDArray[np.float64] = np.rint(values.astype(np.float64) / step)
    return rounded


def _angles(values_rad: NDArray[np.float32]) -> NDArray[np.int16]:
    """Codes of angles, a full turn wrapping round."""
    return _steps(values_rad, ANGLE_STEP_RAD).astype(np.int64).astype(np.uint16).view(np.int16)


def _values(codes: NDArray[np.int16] | NDArray[np.int32], step: float) -> NDArray[np.float32]:
    return (codes.astype(np.float64) * step).astype(np.float32)
