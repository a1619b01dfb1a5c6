"""Recordings of rerun, read back by rerun: times, frames, points and errors are those of the data."""

import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shared_fixtures.readings.raw_gnss import in_a_street, write
from shared_fixtures.readings.slam_dataset import (
    ELEVATIONS_DEG,
    ROOM_M,
    SWEEP_NS,
    list_dataset,
    rig,
    write_dataset,
)

from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.town.town import Town
from recorder.cli.main import main
from recorder.episode.episode import Episode
from recorder.evaluation.trajectory_files import read_tum
from recorder.writers.base import DEFAULT_EPOCH_NS

Capture = pytest.CaptureFixture[str]
STEREO = {"left": 0.25, "right": -0.25}
Column = Callable[[str, str], list[Any]]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("set"), sweeps=10) / "Box"


def columns_of(path: Path) -> Column:
    """What a recording holds: all rows of a column of an entity."""
    chunk = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk")
    found = defaultdict(list)
    for part in chunk.RrdReader(path).stream().to_chunks():
        batch = part.to_record_batch()
        for name in batch.schema.names:
            found[str(part.entity_path).lstrip("/"), name] += batch.column(name).to_pylist()
    return lambda entity, name: found[entity, name]


def stamps(rows: list[Any]) -> list[int]:
    return [int(row.value if hasattr(row, "value") else np.datetime64(row, "ns").astype(int)) for row in rows]


def test_a_sequence_is_told_by_its_own_frames_and_times(dataset: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    out = tmp_path / "look.rrd"
    truth = read_tum(dataset / "ground_truth" / "lidar.tum")
    assert main(["view", str(dataset / "ClearNoon_dynamic"), "--period", "0.1", "--out", str(out),
                 "--estimate", str(dataset / "ground_truth" / "lidar.tum")]) == 0  # fmt: skip
    column = columns_of(out)
    assert stamps(column("world/base_link", "stamp")) == truth.stamp_ns.tolist()
    moved = np.array(column("world/base_link", "Transform3D:translation"))[:, 0]
    np.testing.assert_allclose(moved, truth.position_m, atol=1e-5)
    mount = np.array(column("world/base_link/lidar", "Transform3D:translation"))[0, 0]
    np.testing.assert_allclose(mount, rig().sensors[0].mount.position_m, atol=1e-6)
    clouds = column("world/base_link/lidar/points", "Points3D:positions")
    assert [len(cloud) for cloud in clouds] == [240 * len(ELEVATIONS_DEG)] * 10
    sweeps = stamps(column("world/base_link/lidar/points", "stamp"))
    assert sweeps == [DEFAULT_EPOCH_NS + k * SWEEP_NS for k in range(10)]
    errors = np.array(column("error_m/lidar", "Scalars:scalars"))
    assert len(errors) == len(truth)
    assert errors.max() < 1e-6


def test_the_map_lies_where_the_walls_are(dataset: Path, tmp_path: Path) -> None:
    """Rays were cast from where the LiDAR was at each point's time; noise is 5 mm."""
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    out = tmp_path / "look.rrd"
    assert main(["view", str(dataset / "ClearNoon_dynamic"), "--out", str(out)]) == 0
    column = columns_of(out)
    points = np.array(column("world/map", "Points3D:positions")[0])
    tag = np.array(column("world/map", "Points3D:class_ids")[0])
    wall = points[tag == Tag.BUILDING]
    assert len(wall) > 1000
    faces = np.abs(np.abs(wall - [0, 0, 0.5 * ROOM_M[2]]) - 0.5 * ROOM_M).min(axis=1)
    assert np.percentile(faces, 99) < 0.02
    assert faces.max() < 0.04


def test_images_are_shown_and_a_damaged_one_is_named(tmp_path: Path, capfd: Capture) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    root = write_dataset(tmp_path / "set", sweeps=5)
    eyes = [CameraConfig(name=name, mount=Mount(position_m=(1.0, y, 1.5))) for name, y in STEREO.items()]
    whole = SensorRig(name="box", sensors=(*rig().sensors, *eyes))
    list_dataset(root, whole)
    folder = root / "Box" / "ClearNoon_dynamic"
    images = folder / "mav0" / "cam0" / "data"
    images.mkdir(parents=True)
    names = [DEFAULT_EPOCH_NS + k * 50_000_000 for k in range(5)]
    (images.parent / "data.csv").write_text("#stamp,file\n" + "".join(f"{n},{n}.png\n" for n in names))
    for name in names:
        cv2.imwrite(str(images / f"{name}.png"), np.full((36, 64, 3), 90, np.uint8))
    out = tmp_path / "look.rrd"
    assert main(["view", str(folder), "--period", "0.1", "--out", str(out)]) == 0
    shown = columns_of(out)(f"world/base_link/{eyes[0].frame_id}/image", "stamp")
    assert stamps(shown) == names[::2]
    (images / f"{names[2]}.png").write_bytes(b"no image")
    assert main(["view", str(folder), "--period", "0.1", "--out", str(tmp_path / "b.rrd")]) == 1
    assert f"{names[2]}.png is no image; replay it anew" in capfd.readouterr().err
    assert not (tmp_path / "b.rrd").exists()


def test_the_sky_is_shown_over_time(tmp_path: Path) -> None:
    """Satellites by name, at their azimuths and elevations, at each epoch of the receiver."""
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    pytest.importorskip("open3d", reason="open3d is not installed")
    folder = write_dataset(tmp_path / "set", sweeps=10) / "Box" / "ClearNoon_dynamic"
    _, _, samples = in_a_street(1.0, rate_hz=2.0)
    write(folder / "gnss", samples)
    out = tmp_path / "look.rrd"
    assert main(["view", str(folder), "--out", str(out)]) == 0
    column, raws = columns_of(out), samples["gnss_raw"]
    assert stamps(column("sky/satellites", "stamp")) == [raw.stamp_ns + DEFAULT_EPOCH_NS for raw in raws]
    names, points = (column("sky/satellites", f"Points2D:{name}") for name in ("labels", "positions"))
    for raw, name, point in zip(raws, names, points, strict=True):
        assert name == raw.sky_satellite.tolist()
        azimuth, away = np.radians(raw.sky_azimuth_deg), 90.0 - raw.sky_elevation_deg
        place = np.stack([away * np.sin(azimuth), -away * np.cos(azimuth)], axis=-1)
        np.testing.assert_allclose(point, place, atol=0.02)


def test_an_episode_shows_who_took_part(short_drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    out = tmp_path / "drive.rrd"
    assert main(["view", str(short_drive), "--out", str(out)]) == 0
    drive, column = Episode.load(short_drive), columns_of(out)
    moved = np.array(column("world/base_link", "Transform3D:translation"))[:, 0]
    np.testing.assert_allclose(moved, drive.ego["position_m"], atol=1e-3)
    assert stamps(column("world/base_link", "stamp"))[:3] == [
        DEFAULT_EPOCH_NS + k * 5_000_000 for k in range(3)
    ]
    timeline = drive.timeline()
    steps = len(drive.steps)
    last: ActorFrame = timeline.actors_at((steps - 1) * 50_000_000)
    rows = zip(column("world/actors", "stamp"), column("world/actors", "Boxes3D:centers"), strict=False)
    centres = {stamp: boxes for stamp, boxes in rows if stamp is not None}
    assert len(centres) == steps
    here = np.array(centres[max(centres)])
    assert here.shape == (len(timeline.catalog), 3)
    np.testing.assert_allclose(here[:, :2], last.position_m[:, :2], atol=1e-3)
    np.testing.assert_allclose(
        here[:, 2] - last.position_m[:, 2], 0.5 * timeline.catalog.size_m[:, 2], atol=1e-3
    )


def test_a_town_shows_its_classes(town03: Town, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    out = tmp_path / "town.rrd"
    assert main(["view", "Town03", "--out", str(out)]) == 0
    column = columns_of(out)
    for tag in (Tag.ROAD, Tag.BUILDING):
        corners = column(f"world/town/{tag.name.lower()}", "Mesh3D:vertex_positions")[0]
        assert len(corners) == 3 * (town03.outline.collision_tags == tag).sum()
    driving = [lane for lane in town03.network.lanes if lane.type == "driving"]
    assert len(column("world/lanes", "LineStrips3D:strips")[0]) == len(driving)
    assert town03.route is not None
    verified = subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", str(out)], check=False)
    assert verified.returncode == 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["view", "{tmp}"], "is no sequence and no town"),
        (["view", "Town33"], "Town03"),
        (["view", "{tmp}/none.mcap", "--out", "{tmp}/a.rrd"], "cannot read"),
        (["view", "Town03", "--out", "{tmp}/a.png"], "does not end in .rrd"),
        (
            ["view", "Town03", "--estimate", "x.tum", "--out", "{tmp}/a.rrd"],
            "--estimate and --drive are for sequences",
        ),
    ],
)
def test_what_cannot_be_shown_is_told_in_a_line(
    words: list[str], told: str, tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    assert main([word.format(tmp=tmp_path) for word in words]) in (1, 2)
    error = capfd.readouterr().err.splitlines()
    assert told in error[-1]
    assert not list(tmp_path.iterdir())


def test_without_a_display_the_way_out_is_told(capfd: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert main(["view", "Town03"]) == 1
    assert "--out FILE.rrd" in capfd.readouterr().err


def test_a_benchmark_leaves_recordings(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    pytest.importorskip("small_gicp", reason="the benchmark runs small_gicp")
    data = write_dataset(tmp_path / "set", sweeps=15)
    words = ["benchmark", str(data), "--out", str(tmp_path / "out"), "--methods", "small_gicp", "--rerun"]
    assert main(words) == 0
    column = columns_of(tmp_path / "out" / "recordings" / "Box" / "ClearNoon_dynamic.rrd")
    for name in ("small_gicp", "small_gicp_seg"):
        assert column(f"world/estimates/{name}", "LineStrips3D:strips")
        assert max(error for (error,) in column(f"error_m/{name}", "Scalars:scalars") if error) < 0.2
