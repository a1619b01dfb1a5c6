"""What the tests of the whole share: one short drive, recorded once."""

from pathlib import Path

import pytest
from shared_fixtures.processes.made_once import made_once

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.drive.record import RecordConfig, record

CALM = "dynamic,vehicles=50,walkers=10"


@pytest.fixture(scope="session")
def short_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the scripted driver among Town03's traffic; never write to this file."""

    def make(folder: Path) -> None:
        out = folder / "drive.mcap"
        record(RecordConfig(map="Town03", out=out, duration_s=6.0, seed=3, traffic=CALM))

    return made_once(tmp_path_factory, "short_drive", make) / "drive.mcap"


def small_cameras(rig: SensorRig) -> SensorRig:
    """The rig with pictures of 160×90 pixels."""
    sensors = tuple(
        CameraConfig(name=s.name, mount=s.mount, pinhole=Pinhole.from_fov(160, 90, 90.0))
        if isinstance(s, CameraConfig)
        else s
        for s in rig.sensors
    )
    return SensorRig(name="small", sensors=sensors)
