"""The two tables of semantic tags, against CARLA's documentation."""

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.scene.materials import (
    LEGACY_PALETTE_RGB,
    PALETTE_RGB,
    TAG_TABLES,
    TO_LEGACY,
    Tag,
    colourise,
    tags_in,
)

LEGACY = {
    "unlabeled": 0, "building": 1, "fence": 2, "other": 3, "pedestrian": 4, "pole": 5, "road_line": 6,
    "road": 7, "sidewalk": 8,
    "vegetation": 9, "vehicle": 10, "wall": 11, "traffic_sign": 12, "sky": 13, "ground": 14,
    "bridge": 15, "rail_track": 16, "guard_rail": 17, "traffic_light": 18, "static": 19, "dynamic": 20,
    "water": 21, "terrain": 22,
}  # fmt: skip
"""CARLA 0.9.13's ``CityScapesPalette.h``."""
MERGED = {
    Tag.CAR: "vehicle", Tag.TRUCK: "vehicle", Tag.BUS: "vehicle", Tag.TRAIN: "vehicle",
    Tag.MOTORCYCLE: "vehicle", Tag.BICYCLE: "vehicle", Tag.RIDER: "pedestrian",
}  # fmt: skip
"""Tags that the older table has under one name."""


def test_every_tag_has_its_older_number() -> None:
    every = np.array(list(Tag), dtype=np.uint8)
    older = tags_in("0.9.13", every)
    assert older.tolist() == [LEGACY[MERGED.get(tag, tag.name.lower())] for tag in Tag]
    assert set(older.tolist()) == set(LEGACY.values())
    np.testing.assert_array_equal(tags_in("0.9.14", every), every)
    np.testing.assert_array_equal(older, TO_LEGACY)


def test_pictures_keep_their_shape_and_colours() -> None:
    picture = np.array([[Tag.ROAD, Tag.CAR], [Tag.SKY, Tag.FENCE]], dtype=np.uint8)
    new, old = (colourise(tags_in(table, picture), table) for table in TAG_TABLES)
    assert new.shape == old.shape == (2, 2, 3)
    # Roads, cars and sky kept their colours in 0.9.14; fences did not.
    np.testing.assert_array_equal(new[0], old[0])
    np.testing.assert_array_equal(new[1, 0], old[1, 0])
    assert new[1, 1].tolist() == [190, 153, 153]
    assert old[1, 1].tolist() == [100, 40, 40]
    assert len(PALETTE_RGB) == len(Tag)
    assert len(LEGACY_PALETTE_RGB) == len(LEGACY)


def test_an_unknown_table_is_named() -> None:
    with pytest.raises(ConfigError, match=r"no tag table '0\.9\.12'"):
        tags_in("0.9.12", np.zeros(1, np.uint8))
