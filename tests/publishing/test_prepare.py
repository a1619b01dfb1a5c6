"""A dataset laid out for a hub: within its limits, accepted by mlcroissant, read by pandas and tar."""

import json
import shutil
import tarfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.errors import ConfigError, OutputError
from recorder.cli.main import main
from recorder.dataset.checksums import checksums
from recorder.evaluation.trajectory_files import read_tum
from recorder.publishing import prepare
from recorder.publishing.prepare import prepare_for_hub
from recorder.replaying.replay import ReplayConfig, replay

parquet = pytest.importorskip("pyarrow.parquet", reason="tables need pyarrow")
croissant = pytest.importorskip("mlcroissant", reason="mlcroissant makes Croissant")


@pytest.fixture(scope="module")
def dataset(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a second of a drive under two weathers, as bags and npz."""
    out = tmp_path_factory.mktemp("hub") / "data"
    config = ReplayConfig(
        episode=straight_drive.episode, map=straight_drive.town, out=out, rig="state", duration_s=0.5,
        weathers=("ClearNoon", "FoggyNoon"), formats=("rosbag1", "raw"), workers=1,
    )  # fmt: skip
    replay(config)
    return out


@pytest.fixture(scope="module")
def folder(dataset: Path) -> Path:
    """Laid out with shards from four files a folder on."""
    path = dataset.parent / "hub"
    prepare_for_hub(dataset, path, folder_files=4)
    assert [*path.rglob("*.tar")]
    return path


def test_the_card_names_tables_that_are_there(folder: Path) -> None:
    _, front, text = (folder / "README.md").read_text().split("---\n", 2)
    card = yaml.safe_load(front)
    assert card["license"] == "mit"
    assert [config["config_name"] for config in card["configs"]] == ["trajectories", "conditions"]
    assert all((folder / config["data_files"]).is_file() for config in card["configs"])
    assert "2 sequences of simulated driving" in text


def test_tables(dataset: Path, folder: Path) -> None:
    poses = parquet.read_table(folder / "data/trajectories.parquet").to_pandas()
    truth = read_tum(next(dataset.glob("*/ground_truth/imu.tum")))
    mine = poses[poses.frame == "imu"]
    assert np.array_equal(mine.stamp_ns, truth.stamp_ns)
    assert np.allclose(mine[["tx", "ty", "tz"]], truth.position_m)
    rows = parquet.read_table(folder / "data/conditions.parquet").to_pandas()
    assert sorted(rows.weather) == ["ClearNoon", "FoggyNoon"]
    assert (rows["samples"] > 100).all()


def test_mlcroissant_accepts_the_metadata_and_reads_a_record(folder: Path) -> None:
    found = croissant.Dataset(jsonld=folder / "croissant.json")
    assert not found.metadata.ctx.issues.errors
    assert {"prov:wasGeneratedBy", "rai:dataBiases"} <= json.loads(
        (folder / "croissant.json").read_text()
    ).keys()
    row = next(iter(found.records("conditions")))
    assert row["conditions/weather"] in (b"ClearNoon", b"FoggyNoon", "ClearNoon", "FoggyNoon")


def test_every_file_is_there_or_in_a_shard(dataset: Path, folder: Path) -> None:
    listed = json.loads((folder / "croissant.json").read_text())["distribution"]
    sums = checksums(folder)
    assert all(sums.get(file["@id"], file["sha256"]) == file["sha256"] for file in listed)
    for shard in folder.rglob("*.tar"):
        with tarfile.open(shard) as tar:
            tar.extractall(
                folder / "unpacked" / shard.relative_to(folder).with_name(shard.stem[:-6]), filter="data"
            )
    for name, digest in checksums(dataset).items():
        direct, unpacked = sums.get(name), folder / "unpacked" / name
        assert direct == digest or unpacked.read_bytes() == (dataset / name).read_bytes(), name
    shutil.rmtree(folder / "unpacked")


def test_what_is_no_dataset_and_what_exists_is_refused(dataset: Path, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no dataset\.yaml"):
        prepare_for_hub(tmp_path, tmp_path / "hub")
    with pytest.raises(OutputError, match="exists"):
        prepare_for_hub(dataset, folder)


def test_a_failure_leaves_nothing_behind(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> int:
        raise OSError("No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(prepare, "conditions", fail)
        with pytest.raises(OutputError, match="No space left on device; choose another place"):
            prepare_for_hub(dataset, tmp_path / "hub")
    assert list(tmp_path.iterdir()) == []


def test_missing_packages_are_named_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(prepare, "find_spec", lambda name: None)
    words = ["dataset", "--out", str(tmp_path / "data"), "--hub", str(tmp_path / "hub")]
    assert main([*words, "--sample", "1", "--yes"]) == 1
    assert "--hub needs mlcroissant and pyarrow; pip install 'carlaloc[hub]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
