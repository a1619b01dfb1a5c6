"""Real extracts, where `$CARLALOC_OSM` names a folder of them: no errors, and streets nearly all built."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from carlaloc_env.map.checks.report import check_map
from carlaloc_env.openstreetmap.import_town import import_town, write_town

FOLDER = Path(os.environ.get("CARLALOC_OSM", "/nonexistent"))
EXTRACTS = sorted(FOLDER.glob("*.osm.gz"))


@pytest.mark.long
@pytest.mark.skipif(not EXTRACTS, reason="$CARLALOC_OSM names no folder with extracts of OpenStreetMap")
@pytest.mark.parametrize("path", EXTRACTS, ids=lambda path: path.name.split(".")[0])
def test_a_place(path: Path, tmp_path: Path) -> None:
    town = import_town(path)
    write_town(town, tmp_path)
    assert check_map(tmp_path / "town.xodr").errors == ()
    assert town.report["built_m"] >= 0.95 * town.report["streets_m"]
    assert town.report["junctions"] > 0
