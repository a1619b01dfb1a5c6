"""Samples refuse wrong types and shapes."""

import numpy as np
import pytest

from carlaloc_env import samples


def cloud(**changes: object) -> samples.PointCloud:
    values: dict[str, object] = {
        "sensor": "lidar",
        "frame_id": "lidar",
        "stamp_ns": 0,
        "points_xyz_m": np.zeros((4, 3), np.float32),
        "intensity": np.zeros(4, np.float32),
        "ring": np.zeros(4, np.uint16),
        "offset_ns": np.zeros(4, np.uint32),
        "sweep_ns": 50_000_000,
    }
    return samples.PointCloud(**{**values, **changes})


@pytest.mark.parametrize(
    "wrong",
    [
        {"points_xyz_m": np.zeros((4, 3))},
        {"points_xyz_m": np.zeros((4, 2), np.float32)},
        {"ring": np.zeros(3, np.uint16)},
        {"ring": np.zeros(4, np.int64)},
        {"tag": np.zeros(5, np.uint8)},
        {"instance": np.zeros(4, np.uint8)},
        {"cos_incidence": np.zeros(4)},
    ],
)
def test_wrong_dtype_or_shape_is_refused(wrong: dict[str, object]) -> None:
    cloud()
    with pytest.raises(ValueError, match=f"PointCloud.{next(iter(wrong))}"):
        cloud(**wrong)


def test_wrong_pictures_and_vectors_are_refused() -> None:
    head = {"sensor": "s", "frame_id": "f", "stamp_ns": 0}
    with pytest.raises(ValueError, match=r"Image\.rgb"):
        samples.Image(**head, rgb=np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match=r"DepthImage\.depth_m"):
        samples.DepthImage(**head, depth_m=np.zeros((4, 4)))
    with pytest.raises(ValueError, match=r"Imu\.angular_rate_radps"):
        samples.Imu(**head, specific_force_mps2=np.zeros(3), angular_rate_radps=np.zeros(4))
