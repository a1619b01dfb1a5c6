"""Instants of poses: to which moment of a sweep KISS-ICP's and GICP's poses belong.

For GICP a drive through a closed room tells it. KISS-ICP tells it by the point that its motion correction
leaves alone.
"""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.worlds.closed_room import EPOCH_S, SWEEP_S, TOPIC, late_s, write_room_bag

from recorder.slam.bag_odometry import run_odometry


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("room") / "room.bag"
    write_room_bag(path, np.linspace(-30.0, 20.0, 32))
    return path


def test_gicp_shows_the_middle_of_the_sweep(bag: Path) -> None:
    """At constant speed poses lie where the LiDAR was at their stamps, to 6 ms, an eighth of a sweep."""
    pytest.importorskip("small_gicp")
    estimate = run_odometry(bag, "gicp", TOPIC)
    assert estimate.stamp_ns[0] * 1e-9 - EPOCH_S == pytest.approx(0.5 * SWEEP_S)
    assert abs(late_s(estimate)) < 0.006


def test_kiss_icp_corrects_sweeps_to_their_end(bag: Path) -> None:
    """The last point of a sweep stays where it was measured, the first moves by the whole motion."""
    pytest.importorskip("kiss_icp")
    from kiss_icp.config import KISSConfig
    from kiss_icp.preprocess import get_preprocessor

    config = KISSConfig()
    config.data.deskew = True
    points = np.array([[10.0, 0.0, 0.0], [10.0, 1.0, 0.0], [10.0, 2.0, 0.0]])
    motion = np.eye(4)
    motion[0, 3] = 0.4
    corrected = np.asarray(get_preprocessor(config).preprocess(points, np.array([0.0, 0.025, 0.05]), motion))
    # A point seen 0.4 m before the end lies 0.4 m nearer then.
    np.testing.assert_allclose(points[:, 0] - corrected[:, 0], [0.4, 0.2, 0.0], atol=1e-6)
    stamps = run_odometry(bag, "kiss_icp", TOPIC).stamp_ns
    assert stamps[0] * 1e-9 - EPOCH_S == pytest.approx(SWEEP_S)
