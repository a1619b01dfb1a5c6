"""town.toml: what is read of it, and the one line that each mistake gives."""

from pathlib import Path
from typing import Any

import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.map.config import FEATURE_SIZES, Feature, SignalTiming, TownConfig
from carlaloc_env.map.sources import known_towns
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import TrafficConfig

ZONE = {"kind": "park", "polygon": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]}
PIER = {"kind": "pier", "position": [0.0, 0.0]}
GEO = {"latitude_deg": 49.0, "longitude_deg": 8.4}


def test_configuration_keeps_what_the_file_says() -> None:
    config = TownConfig.from_mapping(
        {
            "town": {"name": "Ulm", "scenery_seed": 3},
            "geo": GEO,
            "route": {"points": [[0, 1], [2, 3]], "loop": True, "length_m": 700},
            "signals": {"green_s": 12, "left_green_s": 5.5},
            "zone": [ZONE],
            "feature": [{**PIER, "size": [30]}],
        }
    )
    assert (config.name, config.scenery_seed) == ("Ulm", 3)
    assert config.route.points == ((0.0, 1.0), (2.0, 3.0))
    assert config.route.length_m == 700.0
    assert config.geo == GeoReference(latitude_deg=49.0, longitude_deg=8.4)
    assert config.zones[0].kind == "park"
    assert config.features[0].size == (30.0,)
    assert config.traffic.vehicles is None
    assert config.signals == SignalTiming(green_s=12.0, left_green_s=5.5)


@pytest.mark.parametrize("name", sorted(known_towns()))
def test_files_of_the_package_are_read_whole(name: str) -> None:
    config = TownConfig.from_toml(known_towns()[name].with_name("town.toml"))
    assert config.name == name
    assert config.geo is not None
    assert config.zones


def test_lights_of_a_town_that_says_nothing_are_those_of_traffic() -> None:
    assert TownConfig().signals == TrafficConfig().timing


@pytest.mark.parametrize(
    ("content", "message"),
    [
        # Values of another type.
        ({"town": {"name": 3}}, r"town\.name: expected str, found 3 \(int\)"),
        ({"town": {"scenery_seed": 0.5}}, r"town\.scenery_seed: expected int, found 0\.5"),
        ({"town": "Ulm"}, "town: expected keys and values, found 'Ulm'"),
        ({"geo": {**GEO, "height_m": "high"}}, r"geo\.height_m: expected float, found 'high' \(str\)"),
        ({"route": {"length_m": "far"}}, r"route\.length_m: expected float, found 'far' \(str\)"),
        ({"route": {"loop": "yes"}}, r"route\.loop: expected bool, found 'yes'"),
        ({"route": {"points": [[0, 1], [2]]}}, r"route\.points\[1\]: expected 2 values, found 1"),
        ({"route": {"start": 4.0}}, r"route\.start: expected a list, found 4\.0"),
        ({"traffic": {"vehicles": "many"}}, r"traffic\.vehicles: expected int, found 'many' \(str\)"),
        ({"traffic": {"walkers": True}}, r"traffic\.walkers: expected int, found True"),
        ({"signals": {"yellow_s": [3.0]}}, r"signals\.yellow_s: expected float"),
        ({"zone": [ZONE, {**ZONE, "polygon": 3}]}, r"zone\[1\]\.polygon: expected a list, found 3"),
        ({"zone": ZONE}, r"zone: write \[\[zone\]\] above each one"),
        ({"feature": [{**PIER, "size": "big"}]}, r"feature\[0\]\.size: expected a list, found 'big'"),
        # Unknown names, with the nearest.
        ({"trafic": {}}, "no section 'trafic'; did you mean 'traffic'"),
        ({"town": {"nam": "Ulm"}}, "town: no key 'nam'; did you mean 'name'"),
        ({"town": {"route": {}}}, "town: no key 'route'"),
        ({"town": {"default_zone": "prk"}}, "town: no zone kind 'prk'; did you mean 'park'"),
        ({"traffic": {"vehicle": 3}}, "traffic: no key 'vehicle'; did you mean 'vehicles'"),
        ({"signals": {"green": 3.0}}, "signals: no key 'green'; did you mean 'green_s'"),
        ({"geo": {"latitude_deg": 49.0}}, "geo: the key 'longitude_deg' is missing"),
        ({"zone": [{"kind": "park"}]}, r"zone\[0\]: the key 'polygon' is missing"),
        ({"zone": [{**ZONE, "kind": "downtwon"}]}, r"zone\[0\]: no zone kind 'downtwon'"),
        ({"feature": [{**PIER, "kind": "peer"}]}, r"feature\[0\]: no feature kind 'peer'; did you mean"),
        # Values out of range.
        ({"geo": {**GEO, "latitude_deg": 91.0}}, "geo: latitude_deg is 91"),
        ({"geo": {**GEO, "longitude_deg": float("nan")}}, "geo: longitude_deg is nan"),
        ({"geo": {**GEO, "height_m": float("inf")}}, "geo: height_m is inf"),
        ({"route": {"length_m": 0.0}}, r"route: length_m is 0; give more than 0 \[m\]"),
        ({"route": {"points": [[0, 1]]}}, "route: points holds one point"),
        ({"route": {"points": [[0, 1], [2, float("nan")]]}}, r"route: points holds .*; give finite numbers"),
        ({"route": {"start": [float("inf"), 0]}}, "route: start holds"),
        ({"traffic": {"vehicles": -1}}, "traffic: vehicles is -1; give 0 or more"),
        ({"traffic": {"walkers": -1}}, "traffic: walkers is -1; give 0 or more"),
        ({"signals": {"green_s": -5}}, r"signals: green_s is -5; give more than 0 \[s\]"),
        ({"signals": {"left_green_s": 0}}, "signals: left_green_s is 0"),
        ({"signals": {"yellow_s": -0.5}}, r"signals: yellow_s is -0\.5; give 0 or more \[s\]"),
        ({"signals": {"all_red_s": float("nan")}}, "signals: all_red_s is nan"),
        ({"signals": {"offset_s": float("inf")}}, "signals: offset_s holds"),
        ({"zone": [{**ZONE, "polygon": [[0, 0], [1, 1]]}]}, r"zone\[0\]: zone 'park' needs at least three"),
        ({"zone": [{**ZONE, "polygon": [[0, 0], [1, 1], [float("nan"), 0]]}]}, r"zone\[0\]: polygon holds"),
        ({"feature": [{**PIER, "position": [0, float("inf")]}]}, r"feature\[0\]: position holds"),
        ({"feature": [{**PIER, "heading_deg": float("nan")}]}, r"feature\[0\]: heading_deg holds"),
        ({"feature": [{**PIER, "size": [0]}]}, r"feature\[0\]: size is 0; give more than 0 \[m\]"),
        ({"feature": [{**PIER, "size": [9, 9]}]}, r"feature\[0\]: size of a pier holds length \[m\]; found"),
    ],
)
def test_mistakes_are_refused_in_one_line(content: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=f"^a.toml: {message}[^\n]*$"):
        TownConfig.from_mapping(content, "a.toml")


@pytest.mark.parametrize("kind", sorted(FEATURE_SIZES))
def test_size_of_a_feature_holds_as_many_numbers_as_are_named(kind: str) -> None:
    count = len([word for word in FEATURE_SIZES[kind].split(", ") if word])
    assert Feature(kind=kind, position=(0.0, 0.0), size=(9.0,) * count).size == (9.0,) * count
    with pytest.raises(ConfigError, match=f"size of a {kind} holds"):
        Feature(kind=kind, position=(0.0, 0.0), size=(9.0,) * (count + 1))


@pytest.mark.parametrize("text", ["[town\n", "[traffic]\nvehicles = 'many'\n", "[traffic]\nvehicles = -1\n"])
def test_loading_a_town_names_the_file_in_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "town.xodr").write_bytes(known_towns()["Town01"].read_bytes())
    (tmp_path / "town.toml").write_text(text)
    with pytest.raises(ConfigError) as raised:
        load_town(tmp_path, cache_dir=tmp_path)
    assert str(raised.value).startswith(f"{tmp_path / 'town.toml'}: ")
    assert "\n" not in str(raised.value)
