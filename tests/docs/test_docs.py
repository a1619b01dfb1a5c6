"""Docs agree with the code: generated pages, tables, links, versions, units in docstrings."""

import dataclasses
import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.processes.checkout import ROOT, script

import carlaloc_env
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.map.checks.report import check_map
from carlaloc_env.map.config import (
    FEATURE_KINDS,
    TOWN_KEYS,
    ZONE_KINDS,
    Feature,
    RoadsideConfig,
    RouteConfig,
    SignalTiming,
    TrafficCounts,
    Zone,
)
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.registry import SENSOR_KINDS
from carlaloc_env.weather.parameters import WeatherParameters
from recorder.drive.record import RecordConfig
from recorder.episode.actor_messages import ACTORS
from recorder.episode.ego_messages import EGO, EVENT
from recorder.episode.traffic_level import TrafficLevel
from recorder.evaluation.align import Alignment
from recorder.replaying.replay import ReplayConfig
from recorder.writers.base import DEFAULT_EPOCH_NS

MAKE_SENSORS = "docs/scripts/make_sensors.py"
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
SECTIONS = {
    "[geo]": GeoReference,
    "[route]": RouteConfig,
    "[traffic]": TrafficCounts,
    "[signals]": SignalTiming,
    "[roadside]": RoadsideConfig,
    "[[zone]]": Zone,
    "[[feature]]": Feature,
}


def text_of(name: str) -> str:
    """Text of a page of docs/."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["make_environments", "make_faults", "make_sensors", "make_topics"])
def test_generated_pages_are_up_to_date(name: str) -> None:
    """The page is what its script writes today."""
    module = script(f"docs/scripts/{name}.py")
    assert module.PAGE.read_text(encoding="utf-8") == module.page(), f"run `python docs/scripts/{name}.py`"


def anchors_of(page: Path) -> set[str]:
    """Anchors of a page's titles, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found: dict[str, int] = {}
    for title in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title)
        slug = re.sub(r"[^\w\- ]", "", plain).strip().lower().replace(" ", "-")
        found[slug] = found.get(slug, 0) + 1
    return {slug + (f"-{k}" if k else "") for slug, times in found.items() for k in range(times)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    """Every relative link and picture is a file of the repository, and every anchor a title of its page."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", text):
        if not target.startswith(("http", "mailto:")):
            file = page.parent / target if target else page
            assert file.exists(), target
            assert not anchor or anchor in anchors_of(file), f"{target}#{anchor}"


WORDS_MAX = 50_000


def test_pages_stay_short() -> None:
    """All words of the pages, as CONTRIBUTING counts them."""
    counted = [page for page in PAGES if page.name not in ("CODE_OF_CONDUCT.md", "SECURITY.md")]
    words = sum(len(page.read_text(encoding="utf-8").split()) for page in counted)
    assert words <= WORDS_MAX, f"{words} words: cut history, and results that another page has"


def test_the_tour_answers_ten_questions_by_names_that_exist() -> None:
    """Each answer names a file, and each name in brackets behind a file is defined there."""
    answers = text_of("tour.md").split("\n## ")[1:]
    assert len(answers) == 10
    for answer in answers:
        assert "`" in answer, answer
        for path, names in re.findall(r"`([\w/]+\.py)`\s\(((?:`\w+`(?:,\s)?)+)\)", answer):
            code = (ROOT / path).read_text(encoding="utf-8")
            for name in re.findall(r"\w+", names):
                defined = re.search(rf"^(?:class |def )?{name}\b[^\n]*[=:(]", code, re.MULTILINE)
                assert defined, f"{path} defines no {name}"


def test_named_make_targets_exist() -> None:
    """Every `make x` of README and CONTRIBUTING is a target, and CONTRIBUTING names all but `clean`."""
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {
        page: set(
            re.findall(r"(?:^|`)make ([\w-]+)", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
        )
        for page in ("README.md", "CONTRIBUTING.md")
    }
    assert named["README.md"] <= targets
    assert named["README.md"] | named["CONTRIBUTING.md"] == targets - {"clean"}


def test_architecture_map_names_every_part() -> None:
    """CONTRIBUTING's map knows all folders and top modules, and nothing that is gone."""
    drawn = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("```")[1]
    for package in (ROOT / "carlaloc_env", ROOT / "recorder"):
        for folder in package.iterdir():
            if (folder / "__init__.py").is_file():
                assert f"{folder.name}/" in drawn or f"{folder.name} " in drawn, folder.name


def test_changelog_and_package_have_one_version() -> None:
    """The newest entry, the package and its metadata agree."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.findall(r"^## \[(\d+\.\d+\.\d+)\]", text, re.MULTILINE)[0]
    assert newest == carlaloc_env.__version__ == version("carlaloc")


def test_conventions_list_all_tags() -> None:
    """Number and name of every tag."""
    rows = re.findall(r"^\| (\d+) \| (\w+) \| \d+ \|$", text_of("conventions.md"), re.MULTILINE)
    assert rows == [(str(int(tag)), tag.name.lower()) for tag in Tag]
    assert f"{DEFAULT_EPOCH_NS // 10**9:,} s".replace(",", " ") in text_of("conventions.md")


def test_maps_page_lists_the_schema() -> None:
    """Every section, key and kind of town.toml is on the page, and no other."""
    page = text_of("maps.md")
    rows = set(re.findall(r"^\| `(\[+\w+\]+)` \| `(\w+)` \|", page, re.MULTILINE))
    expected = {(section, f.name) for section, cls in SECTIONS.items() for f in dataclasses.fields(cls)}
    assert rows == expected | {("[town]", key) for key in TOWN_KEYS}
    for label, kinds in (("Zones", ZONE_KINDS), ("Features", FEATURE_KINDS)):
        line = re.findall(rf"^{label}: (.*)\.$", page, re.MULTILINE)[0]
        assert tuple(re.findall(r"`(\w+)`", line)) == tuple(kinds)


def test_the_plan_on_the_maps_page_is_a_town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's plan builds, and the map check finds nothing wrong with it."""
    monkeypatch.syspath_prepend(ROOT)
    (block,) = re.findall(r"```python\n(.*?)```", text_of("maps.md"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(block, "maps.md", "exec"), names)
    path = tmp_path / "village.xodr"
    path.write_text(names["xodr"], encoding="utf-8")
    report = check_map(path)
    assert not report.errors
    # Three streets of 150 m both ways, some metres more in the turning bulbs and the junction.
    assert 0.8 < report.lane_km < 1.6


def test_formats_page_names_what_files_hold() -> None:
    """Topics and types of an episode, and the words that options take."""
    page = text_of("formats.md")
    for record in (EGO, ACTORS, EVENT):
        assert f"| `{record.topic}` | `{record.name}` |" in page
    for alignment in Alignment:
        assert f"`{alignment.name.lower()}`" in page


UNITLESS = {
    "name", "kind", "mount", "pinhole", "outputs", "axes", "columns", "drop_weak", "ego_returns", "sensor",
    "frame_id", "has_fix", "map", "out", "device", "seed", "traffic", "overwrite", "episode", "weathers",
    "rig", "formats", "topics", "quality", "workers", "preview", "fraction", "loop",
    "ghosts", "weather", "rows", "rays_per_actor", "detections_max", "orientation", "model",
    "constellations", "rtk", "solution", "satellites", "window",
    "lens", "lens_drops", "imager", "shutter", "events", "parked_cars", "green_wave", "cluster",
    "lidar_weather", "faults", "ride", "truth_tf", "clock", "roof_rack", "receiver", "pattern",
    "doppler", "layout", "rings_from_top", "raw",
}  # fmt: skip
"""Fields that are names, choices, counts or shares."""
MEASURE = re.compile(r"\[[^\]]+\]|shape \(|\d[.\d]* (?:is|=) |10 / ")
"""A unit in brackets, a shape, or a value and what it stands for."""
DOCUMENTED: list[type[Any]] = [
    Mount, Pinhole, WeatherParameters, TrafficLevel, RecordConfig, ReplayConfig, RouteConfig, SignalTiming,
    *SENSOR_KINDS.values(), *script(MAKE_SENSORS).sample_classes(),
]  # fmt: skip


@pytest.mark.parametrize("cls", DOCUMENTED, ids=lambda cls: cls.__name__)
def test_every_field_has_a_meaning_and_a_unit_or_shape(cls: type[Any]) -> None:
    """A docstring for every field, with a unit in brackets, a shape or a range unless it plainly has none."""
    for name, doc in script(MAKE_SENSORS).field_docs(cls).items():
        assert doc.endswith((".", ".)")), f"{cls.__name__}.{name} has no sentence"
        if name not in UNITLESS:
            assert MEASURE.search(doc), f"{cls.__name__}.{name}: {doc}"


@pytest.mark.parametrize("cls", DOCUMENTED, ids=lambda cls: cls.__name__)
def test_units_in_names_are_those_in_docstrings(cls: type[Any]) -> None:
    """A field called `…_m` is in metres in its docstring too."""
    units = {"_m": "[m", "_deg": "[deg]", "_hz": "[Hz]", "_ns": "[ns]", "_mps": "[m/s]", "_px": "[px]"}
    units |= {"_radps": "[rad/s]", "_mps2": "[m/s²]", "_per_m": "[1/m]", "_m2": "[m²]", "_s": "[s]"}
    for name, doc in script(MAKE_SENSORS).field_docs(cls).items():
        fitting = [unit for ending, unit in units.items() if name.endswith(ending)]
        # The longest ending counts: `_per_m` before `_m`.
        if fitting:
            longest = max((e for e in units if name.endswith(e)), key=len)
            assert units[longest] in doc, f"{cls.__name__}.{name}: {doc}"
