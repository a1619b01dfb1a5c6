"""The list of towns, against the report of the map check."""

from pathlib import Path

import pytest

from carlaloc_env.map.checks.report import check_map
from carlaloc_env.map.sources import find_town
from recorder.report.town_list import list_towns


def test_sizes_are_those_of_the_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of one's own goes before the installed ones; its map's faults do not matter here."""
    source, folder = find_town("Town01"), tmp_path / "Mine"
    folder.mkdir()
    text = source.read_text(encoding="utf-8")
    faulty = text.replace('<successor id="-1"/>', '<successor id="-9"/>', 1)
    assert faulty != text
    (folder / "town.xodr").write_text(faulty, encoding="utf-8")
    report = check_map(folder / "town.xodr")
    assert report.problems
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path))
    towns = {town.name: town for town in list_towns()}
    mine = towns["Mine"]
    assert (mine.junctions, mine.route_m) == (report.junctions, 0.0)
    assert mine.lane_km == pytest.approx(report.lane_km, rel=1e-12)
    assert {"Town01", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10"} <= set(towns)
    assert towns["Town01"].description
    assert towns["Town01"].route_m == pytest.approx(678.0, rel=0.01)
