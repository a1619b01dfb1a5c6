"""Tags of streets: lanes, widths, limits, sidewalks, levels; absurd ones are ignored."""

from __future__ import annotations

import pytest

from carlaloc_env.openstreetmap.countries import country_of
from carlaloc_env.openstreetmap.elements import Way
from carlaloc_env.openstreetmap.tags import Street, direction, for_cars, number, read_street

AUSTRIA, BRITAIN = country_of(16.37, 48.2), country_of(-1.26, 51.75)


def street(in_town: bool = True, left: bool = False, **tags: str) -> Street:
    tags = {"highway": "residential", **{key.replace("__", ":"): v for key, v in tags.items()}}
    return read_street(Way(1, (1, 2), tags), BRITAIN if left else AUSTRIA, in_town, left=left)


@pytest.mark.parametrize(
    ("tags", "lanes"),
    [
        ({}, (1, 1)),
        ({"lanes": "4"}, (2, 2)),
        ({"lanes": "3"}, (2, 1)),
        ({"lanes": "3", "lanes__backward": "2"}, (1, 2)),
        ({"lanes": "1"}, (1, 1)),
        ({"lanes": "2", "oneway": "yes"}, (2, 0)),
        ({"lanes": "many"}, (1, 1)),
        ({"lanes": "900"}, (1, 1)),
        ({"highway": "motorway"}, (2, 0)),
    ],
)
def test_lanes(tags: dict[str, str], lanes: tuple[int, int]) -> None:
    assert street(**tags).lanes == lanes


def test_a_lane_between_two_kerbs_is_wider() -> None:
    """Where no tag says it: a car that keeps its lane keeps off both kerbs."""
    assert street(oneway="yes").lane_m == 3.5
    assert street(oneway="yes", width="3").lane_m == street(oneway="yes", lanes="2").lane_m == 3.0
    assert street(oneway="yes", highway="motorway", lanes="1").lane_m == 3.75


@pytest.mark.parametrize(
    ("tags", "kmh"),
    [
        ({"maxspeed": "30"}, 30.0),
        ({"maxspeed": "30 mph"}, 48.28032),
        ({"maxspeed": "AT:urban"}, 50.0),
        ({"maxspeed": "AT:zone30"}, 30.0),
        ({"maxspeed": "walk"}, 10.0),
        ({"maxspeed": "none"}, 130.0),
        ({"maxspeed": "fast"}, 50.0),
        ({"highway": "living_street"}, 10.0),
        ({"highway": "tertiary", "zone__maxspeed": "AT:30"}, 30.0),
        ({"highway": "tertiary", "maxspeed__type": "AT:rural"}, 100.0),
        ({"maxspeed__backward": "40"}, 40.0),
    ],
)
def test_limits(tags: dict[str, str], kmh: float) -> None:
    assert street(**tags).speed_kmh == pytest.approx(kmh)


def test_limits_without_a_tag_are_those_of_the_country() -> None:
    assert street(in_town=False, highway="unclassified").speed_kmh == 100.0
    assert street(in_town=False, highway="unclassified", source__maxspeed="AT:urban").speed_kmh == 50.0
    assert street(in_town=False).speed_kmh == 50.0, "by its class, where few houses are mapped"
    assert street(left=True).speed_kmh == pytest.approx(48.28, abs=0.01)
    assert "maxspeed" in street().guesses
    assert "maxspeed" not in street(maxspeed="30").guesses


def test_widths_are_shared_among_lanes_within_bounds() -> None:
    assert street(width="7").lane_m == 3.5
    assert street(width="24 ft").lane_m == pytest.approx(3.6576)
    assert street(width="narrow").lane_m == street().lane_m
    assert street(width="3").lane_m == 2.6


def test_sidewalks_by_tag_else_by_class() -> None:
    assert street(sidewalk="left").walks == (2.0, 0.0)
    assert street(sidewalk="left", left=True).walks == (0.0, 2.0), "mirrored: built for the right"
    assert street(sidewalk="no").walks == (0.0, 0.0)
    assert street().walks == (2.0, 2.0)
    assert street(in_town=False).walks == (0.0, 0.0)
    assert street(sidewalk__left="yes", sidewalk__right="no").walks == (2.0, 0.0)


def test_turn_lanes_are_mirrored_with_the_street() -> None:
    marks = {"oneway": "yes", "lanes": "2", "turn__lanes": "left|through;right"}
    assert street(**marks).turns[0] == ("left", "through;right")
    assert street(left=True, **marks).turns[0] == ("through;left", "right")
    assert street(**{**marks, "lanes": "3"}).turns[0] == ()


def test_levels_of_bridges_and_tunnels() -> None:
    assert street(bridge="yes").level == 1
    assert street(bridge="yes", layer="2").level == 2
    assert street(tunnel="yes").level == -1
    assert street(layer="-2", tunnel="yes").level == -2
    assert street(tunnel="building_passage", layer="-1").level == 0


def test_direction_and_access() -> None:
    assert direction({"highway": "residential", "oneway": "-1"}) == -1
    assert direction({"highway": "residential", "junction": "roundabout"}) == 1
    assert direction({"highway": "motorway", "oneway": "no"}) == 0
    assert for_cars(Way(1, (1, 2), {"highway": "residential"}))
    for tags in ({"access": "private"}, {"motor_vehicle": "no"}, {"area": "yes"}):
        assert not for_cars(Way(1, (1, 2), {"highway": "residential", **tags}))
    assert not for_cars(Way(1, (1, 2), {"highway": "footway"}))
    assert for_cars(Way(1, (1, 2), {"highway": "residential", "access": "no", "motor_vehicle": "yes"}))


def test_numbers() -> None:
    assert number("3,5 m") == 3.5
    assert number("10'") == pytest.approx(3.048)
    assert number("about 3") is None
    assert number(None) is None
