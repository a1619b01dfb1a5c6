"""Every format before every command that reads datasets: it works, or one line says what to do."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.errors import RenderError
from recorder.cli.main import main
from recorder.dataset.checksums import write_checksums
from recorder.dataset.layout import FORMATS as ALL_FORMATS
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.manifest import DatasetManifest, write_manifest
from recorder.drive.record import RecordConfig, record
from recorder.replaying.replay import replay

FORMATS = {name: one for name, one in ALL_FORMATS.items() if name not in ("doppler_icp", "rinex")}
"""Those of any rig; the others need sensors that few rigs have, and have tests of their own."""
BAGS = {name for name, one in FORMATS.items() if one.is_bag}
COMMANDS: dict[str, tuple[Callable[[SequenceFolder, Path, str], list[str]], set[str]]] = {
    "verify": (lambda s, _, __: ["verify", str(s.drive.dataset.path)], set(FORMATS)),
    "info": (lambda s, _, __: ["info", str(s.path)], set(FORMATS)),
    "view": (lambda s, out, _: ["view", str(s.path), "--out", str(out / "look.rrd")], BAGS),
    "odometry": (
        lambda s, out, name: [
            "odometry", str(s.place(name)), "--method", "gicp", "--out", str(out / "gicp.tum"),
        ],
        BAGS,
    ),
    "benchmark small_gicp": (
        lambda s, out, _: [
            "benchmark", str(s.drive.dataset.path), "--methods", "small_gicp", "--clouds", "raw",
            "--out", str(out / "scores"),
        ],
        BAGS,
    ),
    "benchmark stereo_vo": (
        lambda s, out, _: [
            "benchmark", str(s.drive.dataset.path), "--methods", "stereo_vo", "--out", str(out / "scores"),
        ],
        {"euroc"},
    ),
    "evaluate": (
        lambda s, _, name: [
            "evaluate", "--truth", str(s.drive.truth(TRUTH[name][0])), str(s.place(name) / TRUTH[name][1]),
        ],
        BAGS | {"euroc"},
    ),
}  # fmt: skip
"""Words of each command for a sequence in one format, and the formats that it reads.

KITTI's times begin at zero: `evaluate` asks for a time offset.
"""
TRUTH = dict.fromkeys(FORMATS, ("base_link", "")) | {
    "euroc": ("imu", "state_groundtruth_estimate0/data.csv"),
    "kitti": ("camera_left", "poses.txt"),
}
"""Frame and place of the true poses that a format holds."""
NEEDS = {"view": "rerun", "odometry": "small_gicp", "benchmark small_gicp": "small_gicp"}

SLOW = {"benchmark small_gicp": ("rosbag1", "rosbag2", "kitti"), "benchmark stereo_vo": ("rosbag1", "euroc")}
"""Commands that start a process of some seconds, and the formats that are no soak with them."""


@pytest.fixture(scope="module")
def whole(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> SequenceFolder:
    """0.6 s of a drive in all formats; the car has set off by then, so that systems can be scored."""
    folder = tmp_path_factory.mktemp("formats")
    traffic = "dynamic,vehicles=5,walkers=0"
    drive = RecordConfig(map=str(straight_drive.town), out=folder / "a.mcap", duration_s=3.7, traffic=traffic)
    config = straight_drive.config(
        folder / "data", episode=record(drive).path, rig=str(straight_drive.rig), formats=tuple(FORMATS),
        topics="full", start_s=3.0, duration_s=0.6, unit_s=10.0, preview=False,
    )  # fmt: skip
    try:
        return SequenceFolder(replay(config).sequences[0])
    except RenderError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def of_format(whole: SequenceFolder, tmp_path_factory: pytest.TempPathFactory) -> dict[str, SequenceFolder]:
    """The same dataset in each format alone."""
    found = {}
    for name in FORMATS:
        root = tmp_path_factory.mktemp(name) / "data"
        others = [whole.place(other) for other in FORMATS if other != name]
        for path in whole.drive.dataset.path.rglob("*"):
            if path.is_file() and not any(path.is_relative_to(other) for other in others):
                copy = root / path.relative_to(whole.drive.dataset.path)
                copy.parent.mkdir(parents=True, exist_ok=True)
                os.link(path, copy)
        sequence = SequenceFolder(root / whole.path.relative_to(whole.drive.dataset.path))
        for stale in (
            sequence.checksums,
            sequence.drive.dataset.checksums,
            sequence.drive.dataset.description,
        ):
            stale.unlink()
        write_checksums(sequence.path)
        write_manifest(root, DatasetManifest.read(whole.drive.dataset.path).drives, None)
        found[name] = sequence
    return found


@pytest.mark.parametrize(
    ("name", "command"),
    [
        pytest.param(
            name,
            command,
            marks=[pytest.mark.soak] * (command in SLOW and name not in SLOW[command]),
        )
        for name in FORMATS
        for command in COMMANDS
    ],
)
def test_a_format_is_read_or_refused_in_one_line(
    name: str,
    command: str,
    of_format: dict[str, SequenceFolder],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    if command in NEEDS:
        pytest.importorskip(NEEDS[command], reason=f"{command} needs {NEEDS[command]}")
    words, reads = COMMANDS[command]
    status = main(words(of_format[name], tmp_path, name))
    told = capfd.readouterr()
    assert status == (0 if name in reads else 1), told.err
    assert "Traceback" not in told.err
    if status:
        line = told.err.strip().splitlines()[-1]
        assert line.startswith("carlaloc"), line
        assert len(line) < 400


def test_the_table_can_fail(of_format: dict[str, SequenceFolder], tmp_path: Path) -> None:
    """A description without its drives stops every command that needs it."""
    sequence = of_format["rosbag1"]
    broken = tmp_path / "broken"
    for path in sequence.drive.dataset.path.rglob("*"):
        if path.is_file():
            copy = broken / path.relative_to(sequence.drive.dataset.path)
            copy.parent.mkdir(parents=True, exist_ok=True)
            os.link(path, copy)
    description = SequenceFolder(
        broken / sequence.path.relative_to(sequence.drive.dataset.path)
    ).drive.dataset
    text = description.description.read_text().replace("drives:", "drive:")
    description.description.unlink()
    description.description.write_text(text)
    for command in ("verify", "view", "benchmark small_gicp"):
        if command in NEEDS:
            pytest.importorskip(NEEDS[command], reason=f"{command} needs {NEEDS[command]}")
        words = COMMANDS[command][0](
            SequenceFolder(broken / sequence.path.relative_to(sequence.drive.dataset.path)),
            tmp_path,
            "rosbag1",
        )
        assert main(words) == 1
