"""Images without movers: masks out of labelled images, paint that features do not hold on to."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.scene.semantic_tags import Tag
from recorder.dataset.mover_masks import MARGIN_PX, mover_masks, painted_over, pairs_without_movers
from recorder.dataset.readings import StereoPair
from recorder.slam.stereo_vo import StereoOdometry

WIDTH, HEIGHT, CAR = 320, 200, (slice(60, 140), slice(100, 220))
FOCAL_PX, BASELINE_M, DEPTH_M = 200.0, 0.5, 5.0


def texture(width: int, seed: int) -> U8:
    noise = np.random.default_rng(seed).integers(0, 256, (HEIGHT, width), dtype=np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.asarray(cv2.normalize(blurred, None, 0, 255, cv2.NORM_MINMAX), np.uint8)  # type: ignore[call-overload]


def test_masks_are_movers_with_a_rim(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds, name = store.types, "sensor_msgs/msg/Image"
    labels = np.full((HEIGHT, WIDTH), int(Tag.BUILDING), np.uint8)
    labels[CAR] = int(Tag.CAR)
    with Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/camera/left/semantic", name, typestore=store)
        time = kinds["builtin_interfaces/msg/Time"](sec=3, nanosec=7)
        message = kinds[name](
            header=kinds["std_msgs/msg/Header"](seq=0, stamp=time, frame_id="left"), height=HEIGHT,
            width=WIDTH, encoding="mono8", is_bigendian=0, step=WIDTH, data=labels.ravel(),
        )  # fmt: skip
        writer.write(connection, 0, store.serialize_ros1(message, name))
    ((stamp_ns, mask),) = mover_masks(tmp_path / "a.bag", "/camera/left/semantic")
    assert stamp_ns == 3_000_000_007
    wanted = np.zeros_like(mask)
    wanted[60 - MARGIN_PX : 140 + MARGIN_PX, 100 - MARGIN_PX : 220 + MARGIN_PX] = True
    assert np.array_equal(mask, wanted)


def test_paint_is_smooth_and_nothing_else_changes() -> None:
    image, mask = texture(WIDTH, 1), np.zeros((HEIGHT, WIDTH), bool)
    mask[CAR] = True
    painted = painted_over(image, mask)
    assert np.array_equal(painted[~mask], image[~mask])
    inner = (slice(70, 130), slice(110, 210))
    edges = [np.abs(cv2.Laplacian(p, cv2.CV_64F))[inner].mean() for p in (image, painted)]
    assert edges[1] < 0.1 * edges[0]


def test_masks_of_other_times_are_refused() -> None:
    image = texture(WIDTH, 1)
    pair = StereoPair(stamp_ns=5, left=image, right=image)
    masks = [(4, np.zeros((HEIGHT, WIDTH), bool))]
    with pytest.raises(EvaluationError, match="no labelled image of 5"):
        next(pairs_without_movers(iter([pair]), iter(masks), iter(masks)))


def drive(*, masked: bool) -> float:
    """End of a drive of 1.9 m along a wall, past a car as large as 60 % of the view that drives along [m]."""
    wall, car = texture(700, 1), texture(WIDTH, 2)
    body = (slice(20, 180), slice(40, 280))
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[body] = True
    odometry = StereoOdometry(FOCAL_PX, np.array([WIDTH / 2, HEIGHT / 2]), BASELINE_M)
    disparity = round(FOCAL_PX * BASELINE_M / DEPTH_M)
    for k in range(13):
        left, right = (wall[:, a : a + WIDTH].copy() for a in (4 * k, 4 * k + disparity))
        left[body] = car[body]
        right[20:180, 40 - disparity : 280 - disparity] = car[body]
        pair = StereoPair(stamp_ns=k, left=left, right=right)
        if masked:
            (pair,) = pairs_without_movers(iter([pair]), iter([(k, mask)]), iter([(k, mask)]))
        odometry.add(pair)
    return float(odometry.pose[0, 3])


def test_a_car_that_drives_along_leads_astray_until_it_is_masked() -> None:
    way_m = 12 * 4 * DEPTH_M / FOCAL_PX
    assert abs(drive(masked=False) - way_m) > 0.5
    assert drive(masked=True) == pytest.approx(way_m, abs=0.1)
