"""`carlaloc places` over twins of a short drive."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from recorder.cli.main import main

pytest.importorskip("open3d", reason="open3d is not installed")


def test_twins_of_a_drive(
    tmp_path: Path, straight_drive: StraightDrive, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "places"
    words = ["places", str(straight_drive.episode), "--map", str(straight_drive.town), "--out", str(out)]
    words += ["--rig", str(straight_drive.rig), "--json"]
    assert main(words) == 0
    told = json.loads(capfd.readouterr().out)
    count = told["queries"]
    assert count == told["references"] == 1  # the car has not set off yet
    with (out / "pairs.csv").open() as file:
        twins = [row for row in csv.DictReader(file) if row["query"] == row["reference"]]
    assert [float(row["overlap"]) for row in twins] == pytest.approx([1.0] * count, abs=2e-3)
    assert [float(row["distance_m"]) for row in twins] == [0.0] * count

    np.savez(tmp_path / "mine.npz", similarity=np.eye(count))
    own = [*words, "--sensor", "lidar", "--descriptors", str(tmp_path / "mine.npz"), "--overlap", "0.99"]
    assert main(own) == 1
    assert "--force" in capfd.readouterr().err
    assert main([*own, "--force"]) == 0
    assert json.loads(capfd.readouterr().out)["scores"][0]["recall"]["1"] == 1.0
    for wrong, line in (
        (["--methods", "sift_vlad"], "features in all reference images; give 64 or more"),
        (["--methods", "sift_vlat"], "did you mean 'sift_vlad'?"),
        (["--methods", "map_closures"], "give --sensor lidar"),
        (["--sensor", "radar"], "no sensor 'radar'"),
    ):
        assert main([*words, "--force", *wrong]) == 1
        assert line in capfd.readouterr().err
