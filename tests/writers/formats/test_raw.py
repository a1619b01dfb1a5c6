"""The raw format, read back by OpenCV, NumPy and Open3D: every number as it was."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import batch_of, drive, write_all

from carlaloc_env.samples import EVENT, DepthImage, GnssFix, Image, Imu, PointCloud, SemanticImage
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.formats.raw import RawEncoder, RawWriter

SAMPLES = drive()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("raw") / "raw"
    return write_all(RawWriter(path, RawEncoder()), SAMPLES)


def of(kind: type) -> list[Any]:
    return [sample for sample in SAMPLES if isinstance(sample, kind)]


def path_of(folder: Path, sample: Any, end: str) -> Path:
    return folder / sample.sensor / f"{DEFAULT_EPOCH_NS + sample.stamp_ns}{end}"


def test_pictures(folder: Path) -> None:
    for sample in of(Image):
        found = cv2.imread(str(path_of(folder, sample, ".png")))
        assert np.array_equal(cv2.cvtColor(found, cv2.COLOR_BGR2RGB), sample.rgb)
    for sample in of(SemanticImage):
        found = cv2.imread(str(path_of(folder, sample, ".png")), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(found, sample.tag)
        assert np.array_equal(np.load(path_of(folder, sample, ".instance.npz"))["instance"], sample.instance)
    for sample in of(DepthImage):
        assert np.array_equal(np.load(path_of(folder, sample, ".npz"))["depth_m"], sample.depth_m)


def test_clouds_open_in_open3d(folder: Path) -> None:
    o3d = pytest.importorskip("open3d", reason="Open3D reads PLY")
    for sample in of(PointCloud):
        found = o3d.t.io.read_point_cloud(str(path_of(folder, sample, ".ply"))).point
        assert np.array_equal(found.positions.numpy(), sample.points_xyz_m)
        assert np.array_equal(found.intensity.numpy().ravel(), sample.intensity)
        assert np.array_equal(found.ring.numpy().ravel(), sample.ring)
        assert np.array_equal(found.offset_ns.numpy().ravel(), sample.offset_ns)
        if sample.tag is not None:
            assert np.array_equal(found.instance.numpy().ravel(), sample.instance)


def test_tables(folder: Path) -> None:
    imu, samples = np.load(folder / "imu.npz"), of(Imu)
    assert np.array_equal(imu["stamp_ns"], [DEFAULT_EPOCH_NS + s.stamp_ns for s in samples])
    assert np.array_equal(imu["specific_force_mps2"], [s.specific_force_mps2 for s in samples])
    gnss, (fix,) = np.load(folder / "gnss.npz"), of(GnssFix)
    assert (gnss["solution"][0], gnss["has_fix"][0], gnss["latitude_deg"][0]) == ("single", True, 49.1)
    assert np.array_equal(gnss["covariance_enu_m2"][0], fix.covariance_enu_m2)
    assert sorted(path.name for path in folder.glob("*.npz")) == [
        "gnss.npz", "imu.npz", "speed.npz", "truth.npz",
    ]  # fmt: skip
    assert not list(folder.glob(".*"))


def test_events(tmp_path: Path) -> None:
    rows = np.zeros(3, EVENT)
    rows["t"], rows["x"] = (1, 2, 3), (4, 5, 6)
    sample = batch_of(rows, 10, (9, 8), 10)
    write_all(RawWriter(tmp_path / "raw", RawEncoder()), [sample])
    found = np.load(path_of(tmp_path / "raw", sample, ".npz"))
    assert np.array_equal(found["events"], rows)
    assert (int(found["width_px"]), int(found["period_ns"])) == (9, 10)
