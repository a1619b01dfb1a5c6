"""Datasets that are damaged, one kind of damage at a time: each is found and named."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.errors import ConfigError
from recorder.cli.main import main
from recorder.replaying.replay import replay
from recorder.verification.verify import verify

SEQUENCE = "straight/ClearNoon_dynamic"


@pytest.fixture(scope="module")
def whole(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second with LiDAR, depth, IMU, a stereo pair, in three formats."""
    out = tmp_path_factory.mktemp("verify") / "data"
    config = straight_drive.config(
        out, rig=str(straight_drive.rig), formats=("rosbag1", "euroc", "kitti", "nuscenes", "colmap"),
        duration_s=1.0, unit_s=10.0, preview=False,
    )  # fmt: skip
    need_opengl()
    replay(config)
    return out


def flip_a_bit(data: Path) -> None:
    path = data / SEQUENCE / "ClearNoon_dynamic.bag"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)


def lose_an_image(data: Path) -> None:
    sorted((data / SEQUENCE / "mav0/cam0/data").iterdir())[7].unlink()


def leave_a_gap(data: Path) -> None:
    table = data / SEQUENCE / "mav0/imu0/data.csv"
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join(lines[:100] + lines[110:]))


def shift_a_stereo_stamp(data: Path) -> None:
    folder = data / SEQUENCE / "mav0/cam1"
    image = sorted((folder / "data").iterdir())[3]
    later = str(int(image.stem) + 2_000_000)
    image.rename(image.with_stem(later))
    (folder / "data.csv").write_text((folder / "data.csv").read_text().replace(image.stem, later))


def tell_a_wrong_count(data: Path) -> None:
    path = data / SEQUENCE / "sequence.yaml"
    document = yaml.safe_load(path.read_text())
    document["samples"]["imu"] += 1
    path.write_text(yaml.safe_dump(document))


def lose_a_label(data: Path) -> None:
    (data / SEQUENCE / "kitti/labels/000004.label").unlink()


def lose_a_sweep(data: Path) -> None:
    sorted((data / SEQUENCE / "nuscenes/sweeps/LIDAR_TOP").iterdir())[3].unlink()


def lose_a_view(data: Path) -> None:
    sorted((data / SEQUENCE / "colmap/images").glob("left_*"))[3].unlink()


def lose_a_clean_plate(data: Path) -> None:
    (data / "straight/ClearNoon_static/colmap/images").mkdir(parents=True)


def add_a_file(data: Path) -> None:
    (data / SEQUENCE / "notes.txt").write_text("mine")


def _move(data: Path, frame: str, change: Callable[[list[list[float]]], None]) -> None:
    path = data / "straight/calibration/extrinsics.yaml"
    document = yaml.safe_load(path.read_text())
    change(document["frames"][frame][f"T_base_link_{frame}"])
    path.write_text(yaml.safe_dump(document))


def move_the_lidar(data: Path) -> None:
    def change(T: list[list[float]]) -> None:
        T[2][3] += 1.5

    _move(data, "lidar", change)


def turn_the_imu(data: Path) -> None:
    def change(T: list[list[float]]) -> None:
        # A quarter of a turn about the forward axis.
        T[:3] = [[1.0, 0.0, 0.0, T[0][3]], [0.0, 0.0, -1.0, T[1][3]], [0.0, 1.0, 0.0, T[2][3]]]

    _move(data, "imu", change)


DAMAGES: list[tuple[Callable[[Path], None], str]] = [
    (flip_a_bit, f"{SEQUENCE}/ClearNoon_dynamic.bag: changed since it was written"),
    (lose_an_image, "mav0/cam0: 1 images are missing"),
    (leave_a_gap, "mav0/imu0 has 1 gaps, the first of 0.055 s"),
    (shift_a_stereo_stamp, "mav0/cam0 and cam1 have 2 unequal stereo stamps"),
    (tell_a_wrong_count, "/imu/data has 200 messages instead of 201"),
    (lose_a_label, "kitti has unequal counts: velodyne 19, labels 18"),
    (lose_a_sweep, "nuscenes: 1 files are missing, the first is sweeps/LIDAR_TOP/"),
    (lose_a_view, "colmap: 1 files are missing, the first is images/left_"),
    (lose_a_clean_plate, "colmap: images/left_1672531200000000000.png has no twin in ClearNoon_static"),
    (add_a_file, f"{SEQUENCE}/notes.txt: not part of the dataset"),
    (move_the_lidar, "LiDAR does not fit /camera/left/depth"),
    (turn_the_imu, "IMU does not fit the truth: accelerations"),
]


@pytest.mark.parametrize(("damage", "line"), DAMAGES, ids=lambda one: getattr(one, "__name__", ""))
def test_damage_is_named(damage: Callable[[Path], None], line: str, whole: Path, tmp_path: Path) -> None:
    data = tmp_path / "data"
    shutil.copytree(whole, data)
    damage(data)
    findings = verify(data).findings
    assert [found for found in findings if line in found], findings


def test_a_whole_dataset_has_nothing_wrong(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(whole), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["findings"] == []
    assert found["sequences"] == 1
    assert found["files"] > 60


def test_what_is_no_dataset_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"holds no dataset\.yaml"):
        verify(tmp_path)
