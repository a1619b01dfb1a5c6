"""What the tests of the whole share: one short drive, recorded once."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorder.drive.record import RecordConfig, record

CALM = "dynamic,vehicles=50,walkers=10"


@pytest.fixture(scope="session")
def short_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the scripted driver among Town03's traffic; never write to this file."""
    path = tmp_path_factory.mktemp("short_drive") / "drive.mcap"
    record(RecordConfig(map="Town03", out=path, duration_s=6.0, seed=3, traffic=CALM))
    return path
