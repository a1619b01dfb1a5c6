"""Several cars from drive to score, and in an imported town."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from shared_fixtures.worlds.imported_towns import made
from shared_fixtures.worlds.street_sketches import Sketch

from carlaloc_env.core import transforms
from recorder.cli.main import main
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.evaluation.trajectory_files import read_tum

RIG = {
    "name": "lean",
    "sensors": [
        {"kind": "imu", "mount": {"position_m": [1.4, 0.0, 1.5]}},
        {"kind": "lidar", "mount": {"position_m": [1.4, 0.0, 1.9]}, "columns": 360},
    ],
}


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cars, nine seconds, replayed for both, and scored."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "lean.yaml").write_text(yaml.safe_dump(RIG))
    drive = ["record", "--map", "Town01", "--cars", "2", "--overlap", "1", "--traffic", "static"]
    assert main([*drive, "--duration", "9", "--seed", "3", "--out", str(folder / "two.mcap")]) == 0
    replayed = ["replay", str(folder / "two.mcap"), "--out", str(folder / "data"), "--car", "all"]
    asked = ["--rig", str(folder / "lean.yaml"), "--traffic", "empty", "--format", "rosbag2", "--start", "2"]
    assert main([*replayed, *asked, "--no-preview", "--workers", "1"]) == 0
    return folder


def test_both_cars_have_data_in_one_world_and_their_own_noise(fleet: Path) -> None:
    """Same stamps in both truths, positions of the file, and noise that differs."""
    episode = Episode.load(fleet / "two.mcap")
    truths = [
        read_tum(fleet / "data" / f"car{k}" / "Town01" / "ground_truth" / "base_link.tum") for k in (1, 2)
    ]
    np.testing.assert_array_equal(truths[0].stamp_ns, truths[1].stamp_ns)
    for truth, rows in zip(truths, episode.egos, strict=True):
        # The spline runs within a centimetre of the states that control it.
        np.testing.assert_allclose(truth.position_m[0], rows["position_m"][400], atol=0.01)
    seeds = [
        yaml.safe_load((fleet / "data" / f"car{k}" / "dataset.yaml").read_text())["drives"]["Town01"][
            "noise_seed"
        ]
        for k in (1, 2)
    ]
    assert seeds[0] == 3
    assert seeds[1] != 3


def test_truth_between_cars_is_that_of_both_truths(fleet: Path) -> None:
    """Relative poses and closures against the truth of each car."""
    between = fleet / "data" / "between_cars"
    truths = [
        read_tum(fleet / "data" / f"car{k}" / "Town01" / "ground_truth" / "base_link.tum") for k in (1, 2)
    ]
    T = [transforms.transform(truth.position_m, truth.quat_xyzw) for truth in truths]
    relative = read_tum(between / "car1_car2.tum")
    rows = np.searchsorted(truths[0].stamp_ns, relative.stamp_ns)
    expected = transforms.invert(T[0][rows]) @ T[1][rows]
    np.testing.assert_allclose(relative.position_m, expected[:, :3, 3], atol=1e-5)
    closures = list(csv.DictReader((between / "closures.csv").open()))
    assert len(closures) > 5
    epoch = truths[0].stamp_ns[0] - 2_000_000_000
    for row in closures:
        a, b = (int(np.searchsorted(truths[0].stamp_ns, epoch + int(row[f"stamp_{c}_ns"]))) for c in "ab")
        expected = transforms.invert(T[0][a]) @ T[1][b]
        np.testing.assert_allclose([float(row[f"{c}_m"]) for c in "xyz"], expected[:3, 3], atol=1e-4)
        assert 0.3 <= float(row["overlap"]) <= 1.0
    assert list(csv.DictReader((between / "radio.csv").open()))


def test_systems_are_scored_together(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """KISS-ICP over both cars: errors of each, of all, and between them."""
    pytest.importorskip("kiss_icp")
    asked = [
        "benchmark",
        str(fleet / "data"),
        "--methods",
        "kiss_icp",
        "--out",
        str(fleet / "scores"),
        "--json",
    ]
    assert main(asked) == 0
    result = json.loads(capsys.readouterr().out)
    (row,) = result["cars"]
    assert row["cars"] == 2
    assert row["failed"] == ""
    # Alone, as the benchmark scores each; one fit for all cannot be better than a fit for each.
    alone_m = [score["ape_m"] for score in result["scores"]]
    assert [float(text) for text in row["alone_m"].split()] == pytest.approx(alone_m, abs=1e-3)
    assert row["joint_m"] > np.sqrt(np.mean(np.square(alone_m))) - 0.01
    assert row["between_m"] > 0.0
    assert (fleet / "scores" / "cars.csv").is_file()


def test_a_single_car_can_be_asked_for_and_others_are_refused(fleet: Path) -> None:
    """`--car 3` of two names what there is."""
    replayed = ["replay", str(fleet / "two.mcap"), "--out", str(fleet / "third"), "--car", "3"]
    assert main([*replayed, "--rig", str(fleet / "lean.yaml"), "--format", "rosbag2"]) == 1
    assert not (fleet / "third").exists()


def test_three_cars_in_an_imported_town_do_not_touch_each_other(tmp_path: Path) -> None:
    """A minute of three cars on streets of OpenStreetMap, among traffic."""
    sketch = Sketch()
    sketch.way((-260.0, 0.0), (0.0, 0.0), (260.0, 20.0), highway="secondary", name="High Street")
    sketch.way((0.0, -220.0), (0.0, 0.0), (30.0, 230.0), highway="residential", name="Mill Lane")
    sketch.way((-120.0, 0.0), (-110.0, 90.0), (12.0, 88.0), highway="residential", name="Back Lane")
    made(sketch, tmp_path)
    out = tmp_path / "three.mcap"
    config = RecordConfig(map=str(tmp_path / "town.xodr"), out=out, cars=3, duration_s=60.0, seed=2)
    result = record(config)
    assert len(result.cars) == 3
    assert all(car["driven_m"] > 20.0 for car in result.cars)
    episode = Episode.load(out)
    ids = {str(car["id"]) for car in episode.header.cars}
    touches = [
        event.data["with"]
        for number in (1, 2, 3)
        for event in episode.of_car(number).events
        if event.kind == "collision"
    ]
    assert not ids.intersection(touches)
