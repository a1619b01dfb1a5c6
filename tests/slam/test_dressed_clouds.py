"""The same drive in the dressings of other people's drivers and bags: the same poses at the same times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.readings import dressed_clouds as clouds
from shared_fixtures.readings.dressed_clouds import SWEEPS, TOPIC, Dressing, dressed
from shared_fixtures.readings.slam_dataset import SWEEP_NS

from recorder.evaluation.trajectory import Trajectory
from recorder.slam.bag_odometry import run_odometry
from recorder.writers.base import DEFAULT_EPOCH_NS

NOW = DEFAULT_EPOCH_NS
END = SWEEP_NS * 239 // 240
"""Time of the last point of a sweep [ns]."""
DRESSINGS = {
    "velodyne": Dressing(),
    "ouster, organised": Dressing(time=("t", "u4"), unit_ns=1, height=16, pad=20, ring=("ring", "u1")),
    "hesai": Dressing(time=("timestamp", "f8"), zero_ns=0, ring=("ring", "u2")),
    "robosense, padded rows": Dressing(time=("timestamp", "f8"), zero_ns=0, height=4, row_pad=7),
    "livox, as points": Dressing(time=("timestamp", "f8"), zero_ns=0, unit_ns=1, ring=("line", "u1")),
    "double coordinates": Dressing(xyz="f8", ring=("ring", "f4")),
    "whole nanoseconds": Dressing(time=("offset_time", "u4"), unit_ns=1, ring=("channel", "i4")),
    "microseconds": Dressing(time=("time", "f4"), unit_ns=1000, ring=None),
    "stamped at the end": Dressing(header_ns=END),
    "stamped in the middle": Dressing(header_ns=END // 2, time=("time_offset", "i4"), unit_ns=1),
    "big-endian": Dressing(order=">", time=("time_stamp", "f8")),
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
    for method, library in (("kiss_icp", "kiss_icp"), ("gicp", "small_gicp")):
        pytest.importorskip(library)
        want, got = plain(method), run_odometry(bag, method)
        assert len(got.stamp_ns) == SWEEPS
        np.testing.assert_allclose(got.stamp_ns, want.stamp_ns, atol=2_000)
        np.testing.assert_allclose(got.position_m, want.position_m, atol=1e-3)
    assert bool(caplog.messages) == (name == "microseconds")
