"""Ground truth as EuRoC's table of states."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.timeline.motion import Motion
from recorder.writers.base import DEFAULT_EPOCH_NS, write_text

STATE_HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], "
    "b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], "
    "b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
)
"""First line of EuRoC's state_groundtruth_estimate0/data.csv."""


def state_line(
    unix_ns: int,
    position_m: ArrayLike,
    quat_xyzw: ArrayLike,
    velocity_world_mps: ArrayLike,
    gyro_bias_radps: ArrayLike = (0.0, 0.0, 0.0),
    accel_bias_mps2: ArrayLike = (0.0, 0.0, 0.0),
) -> str:
    """One line of 17 columns; numbers are written so that they read back exactly."""
    w_first = np.roll(np.asarray(quat_xyzw, np.float64), 1)
    columns = (position_m, w_first, velocity_world_mps, gyro_bias_radps, accel_bias_mps2)
    numbers = np.concatenate([np.asarray(column, np.float64) for column in columns])
    return ",".join([str(unix_ns), *map(repr, numbers.tolist())])


def write_state_csv(path: str | Path, motion: Motion, *, biases: NDArray[np.float64] | None = None) -> None:
    """Write EuRoC's table of true states of the IMU frame.

    Args:
        path: New file.
        motion: Motion of the IMU frame.
        biases: True biases, accelerometer [m/s²] then gyroscope [rad/s], shape (M, 6); None: zero.

    Raises:
        WriterError: the file exists or cannot be written.
    """
    if biases is None:
        biases = np.zeros((len(motion.stamp_ns), 6))
    states = zip(
        (DEFAULT_EPOCH_NS + motion.stamp_ns).tolist(),
        motion.position_m,
        motion.quat_xyzw,
        motion.velocity_world_mps,
        biases[:, 3:],
        biases[:, :3],
        strict=True,
    )
    write_text(path, "\n".join([STATE_HEADER, *(state_line(*state) for state in states)]) + "\n")
