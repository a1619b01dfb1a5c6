"""Maps with little to drive on: a short road, a ring, no lane at all; and how many others they take."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import MakeEnv
from shared_fixtures.worlds.small_towns import straight_road

from carlaloc_env.core.errors import MapError
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from recorder.cli.commands import info
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.summary import summarise
from recorder.episode.writer import EpisodeWriter

HEAD = '<OpenDRIVE><header revMajor="1" revMinor="7"/>'
FLAT = ((0.0, 0.0, 0.0, 0.0, 0.0),)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))


def street(folder: Path, length_m: float, lanes: tuple[tuple[str, float], ...], toml: str = "") -> Path:
    """A straight road, the same on both sides, and its town.toml."""
    path = folder / "town.xodr"
    path.write_text(f"{HEAD}{straight_road(1, (0.0, 0.0, 0.0), length_m, FLAT, lanes)}</OpenDRIVE>")
    if toml:
        (folder / "town.toml").write_text(toml)
    return path


@pytest.mark.parametrize("route", ["town", "random"])
def test_a_road_of_30_m_resets_and_steps(make_env: MakeEnv, tmp_path: Path, route: str) -> None:
    env = make_env(map=street(tmp_path, 30.0, (("driving", 3.5),)), traffic="dynamic")
    for seed in range(3):
        _, told = env.reset(seed=seed, options={"route": route})
        assert 10.0 < told["route_length_m"] <= 30.0
        for _ in range(5):
            env.step(np.array([0.0, 0.2], np.float32))


def test_a_route_alone_makes_a_town(tmp_path: Path) -> None:
    """Without [traffic], 300 m of road without sidewalks take 5 vehicles (8 a kilometre) and no walkers."""
    toml = "[route]\npoints = [[10.0, -1.75], [290.0, -1.75]]\n"
    path = street(tmp_path, 300.0, (("driving", 3.5),), toml)
    out = tmp_path / "drive.mcap"
    record(RecordConfig(map=str(path), out=out, duration_s=1.0))
    assert len(Episode.load(out).header.catalog) == 5


def test_a_map_without_driving_lanes_is_refused_in_a_line(tmp_path: Path) -> None:
    path = street(tmp_path, 100.0, (("sidewalk", 3.0),))
    with pytest.raises(MapError, match=r"^town.xodr: no lane is of type driving[^\n]*$"):
        CarlaLocEnv(map=path, rig="state")
    with pytest.raises(MapError, match="no lane is of type driving"):
        record(RecordConfig(map=str(path), out=tmp_path / "drive.mcap"))
    assert not list(tmp_path.glob("drive*"))


def test_an_episode_without_a_tick_has_no_nan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What was cut off before the first tick has no ends to compare."""
    EpisodeWriter(tmp_path / "empty.mcap", EpisodeHeader(map_name="Town03")).abandon()
    (recording,) = tmp_path.glob("empty*")
    summary = summarise(Episode.load(recording, allow_partial=True))
    assert summary.closure_m is None
    assert not summary.loop_closed
    info.show(asdict(summary))
    assert "nan" not in capsys.readouterr().out


def test_a_road_of_a_junction_that_is_not_there_is_driven_on(make_env: MakeEnv, tmp_path: Path) -> None:
    """As in a map cut out of a larger one."""
    path = street(tmp_path, 40.0, (("driving", 3.5),))
    path.write_text(path.read_text().replace('junction="-1"', 'junction="371"'))
    env = make_env(map=path, traffic="static")
    env.reset(seed=1)
    assert env.world.route.length_m > 20.0
