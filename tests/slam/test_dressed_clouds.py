"""The same drive in the dressings of other people's drivers and bags: the same poses at the same times."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.readings import dressed_clouds as clouds
from shared_fixtures.readings.dressed_clouds import SWEEPS, TOPIC, Dressing, dressed
from shared_fixtures.readings.slam_dataset import SWEEP_NS, pose

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.trajectory import Trajectory
from recorder.slam import bag_odometry
from recorder.slam.bag_odometry import BagScans, run_odometry
from recorder.writers.base import DEFAULT_EPOCH_NS

NOW = DEFAULT_EPOCH_NS
END = SWEEP_NS * 239 // 240
"""Time of the last point of a sweep [ns]."""
LIBRARIES = {"kiss_icp": "kiss_icp", "gicp": "small_gicp"}
"""Modules of methods; GenZ-ICP gives other poses for the same clouds each time."""
DRESSINGS = {
    "velodyne": Dressing(),
    "hesai": Dressing(time=("timestamp", "f8"), zero_ns=0, ring=("ring", "u2")),
    "microseconds": Dressing(time=("time", "f4"), unit_ns=1000, ring=None),
    "stamped at the end": Dressing(header_ns=END),
    "rays without return": Dressing(no_return=True),
}
"""Ways in which drivers put points into messages."""


def ros1(path: Path, dressing: Dressing) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    return clouds.write_ros1(path / "run.bag", store, _messages(store, dressing))


def mcap(path: Path, dressing: Dressing, **how: str) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    return clouds.write_ros2(path / "run", store, _messages(store, dressing), **how)


def _messages(store: Any, dressing: Dressing) -> dict[str, list[Any]]:
    return {TOPIC: [dressed(store, k, dressing) for k in range(SWEEPS)]}


def _humble(path: Path) -> Path:
    return clouds.without_definitions(mcap(path, Dressing(), storage="SQLITE3"), "humble", 5)


def _livox(path: Path) -> Path:
    store = clouds.with_livox(Stores.ROS2_HUMBLE)
    folder = clouds.write_ros2(
        path / "run", store, {TOPIC: [clouds.livox(store, k) for k in range(SWEEPS)]}, storage="SQLITE3"
    )
    return clouds.without_definitions(folder, "humble", 5)


def _livox_ros1(path: Path) -> Path:
    store = clouds.with_livox(Stores.ROS1_NOETIC)
    return clouds.write_ros1(
        path / "run.bag", store, {TOPIC: [clouds.livox(store, k) for k in range(SWEEPS)]}
    )


BAGS: dict[str, Callable[[Path], Path]] = {
    **{name: lambda path, d=dressing: ros1(path, d) for name, dressing in DRESSINGS.items()},
    "ROS 2, MCAP": lambda path: mcap(path, Dressing()),
    "ROS 2, big-endian and padded": lambda path: mcap(path, Dressing(order=">", height=4, row_pad=3)),
    "ROS 2, Humble's SQLite without definitions": _humble,
    "ROS 2, packed files": lambda path: mcap(path, Dressing(), storage="SQLITE3", compression="FILE"),
    "ROS 2, packed messages": lambda path: mcap(path, Dressing(), storage="SQLITE3", compression="MESSAGE"),
    "ROS 2, bare file": lambda path: mcap(path, Dressing()) / "run.mcap",
    "Livox, ROS 2 without definitions": _livox,
    "Livox, ROS 1": _livox_ros1,
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Trajectory]:
    """Trajectory of the plain dressing by a method."""
    bag = ros1(tmp_path_factory.mktemp("plain"), Dressing())
    return lambda method: run_odometry(bag, method)


@pytest.mark.parametrize("name", BAGS)
def test_dressings_give_the_same_poses(
    name: str, plain: Callable[[str], Trajectory], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = BAGS[name](tmp_path)
    for method, library in LIBRARIES.items():
        pytest.importorskip(library)
        want, got = plain(method), run_odometry(bag, method)
        assert len(got.stamp_ns) == SWEEPS
        np.testing.assert_allclose(got.stamp_ns, want.stamp_ns, atol=2_000)
        np.testing.assert_allclose(got.position_m, want.position_m, atol=1e-3)
    assert bool(caplog.messages) == (name == "microseconds")


def test_the_plain_dressing_follows_the_truth(plain: Callable[[str], Trajectory]) -> None:
    """KISS-ICP notices the first metres late, GICP does not."""
    pytest.importorskip("small_gicp")
    estimate = plain("gicp")
    position_m, _ = pose((estimate.stamp_ns - NOW) * 1e-9)
    ways_m = [
        np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in (position_m, estimate.position_m)
    ]
    assert ways_m[1] == pytest.approx(ways_m[0], rel=0.1)


@pytest.mark.parametrize("method", LIBRARIES)
def test_clouds_without_times_show_the_middle_of_the_sweep(
    method: str, plain: Callable[[str], Trajectory], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip(LIBRARIES[method])
    got = run_odometry(ros1(tmp_path, Dressing(time=None)), method)
    assert got.stamp_ns.tolist() == [NOW + k * SWEEP_NS + SWEEP_NS // 2 for k in range(SWEEPS)]
    assert "no motion correction" in caplog.messages[0]
    # GICP is not given times; KISS-ICP's clouds stay as the motion bent them.
    is_same = np.allclose(got.position_m, plain(method).position_m, rtol=0, atol=1e-3)
    assert is_same == (method == "gicp")


def test_clouds_without_points_are_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pytest.importorskip("kiss_icp")
    store = get_typestore(Stores.ROS1_NOETIC)
    found = _messages(store, Dressing())[TOPIC]
    for k in range(3):
        found[k] = replace(found[k], width=0, row_step=0, data=np.zeros(0, np.uint8))
    got = run_odometry(clouds.write_ros1(tmp_path / "a.bag", store, {TOPIC: found}), "kiss_icp")
    assert got.stamp_ns.tolist() == [NOW + (k + 1) * SWEEP_NS for k in range(3, SWEEPS)]
    assert "3 of 12 clouds have no points and are left out" in caplog.messages[0]
    with pytest.raises(EvaluationError, match="has no two point clouds"):
        run_odometry(clouds.write_ros1(tmp_path / "b.bag", store, {TOPIC: found[:4]}), "kiss_icp")


def test_a_sweep_shorter_than_the_interval_ends_with_its_last_point(tmp_path: Path) -> None:
    """Every second cloud is missing: the interval is twice the sweep, and poses still stand at its end."""
    pytest.importorskip("kiss_icp")
    store = get_typestore(Stores.ROS1_NOETIC)
    found = _messages(store, Dressing())[TOPIC][::2]
    got = run_odometry(clouds.write_ros1(tmp_path / "a.bag", store, {TOPIC: found}), "kiss_icp")
    want = [NOW + k * SWEEP_NS + END for k in range(0, SWEEPS, 2)]
    np.testing.assert_allclose(got.stamp_ns, want, rtol=0, atol=1000)


@pytest.mark.parametrize(
    ("moved_m", "turned_rad", "is_told"), [(0.3, 0.0, True), (2.4, 0.0, False), (0.3, 0.5, False)]
)
def test_clouds_that_travel_while_the_estimate_stays_are_reported(
    moved_m: float, turned_rad: float, is_told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A car that turns on the spot sees its surroundings move round it."""
    source = BagScans(Path("run.bag"), None)
    source.middles_m.extend(np.array([0.2 * k, 1.0, 0.0]) for k in range(12))
    last = np.eye(4)
    last[:3, :3] = transforms.quat_to_matrix(transforms.rpy_to_quat(0.0, 0.0, turned_rad))
    last[0, 3] = moved_m
    bag_odometry._warn_of_registered(source, [(0, np.eye(4)), (1, last)])
    assert ("clouds travel by 2.2 m while the estimate moves by 0.3 m" in caplog.text) == is_told
