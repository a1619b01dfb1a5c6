"""OpenDRIVE files for tests: small ones of our own, the packaged towns, and CARLA's, which are not ours."""

import os
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
CROSSING = ROOT / "tests" / "data" / "crossing.xodr"
"""Four legs of 70 m, written by hand."""
VILLAGE = ROOT / "tests" / "data" / "village.xodr"
"""Two junctions, South with lights and North with a stop sign, and three streets of a lane each way."""
TOWNS = sorted((ROOT / "maps").glob("*/town.xodr"))
_CARLA = Path(os.environ.get("CARLA_XODR", ROOT.parent / "shared" / "data" / "carla_xodr"))


def carla_map(name: str, *values: Any) -> Any:
    """CARLA's map of a town, and what is known of it, as a parameter; its tests skip without the file."""
    path = _CARLA / f"{name}.xodr"
    missing = pytest.mark.skipif(
        not path.exists(), reason=f"{name}.xodr of CARLA is not in $CARLA_XODR ({_CARLA})"
    )
    return pytest.param(path, *values, marks=missing, id=f"CARLA-{name}")


MAPS = [
    *(pytest.param(path, id=path.parent.name) for path in TOWNS),
    pytest.param(VILLAGE, id="village"),
    carla_map("Town01"),
    carla_map("Town07"),
]
"""All that describe a whole town, as parameters."""
