"""Colours of semantic tags, against CARLA's documentation."""

import numpy as np

from carlaloc_env.scene.semantic_tags import PALETTE_RGB, Tag, colourise


def test_pictures_keep_their_shape_and_colours() -> None:
    picture = np.array([[Tag.ROAD, Tag.CAR], [Tag.SKY, Tag.FENCE]], dtype=np.uint8)
    colours = colourise(picture)
    assert colours.tolist() == [[[128, 64, 128], [0, 0, 142]], [[70, 130, 180], [190, 153, 153]]]
    assert len(PALETTE_RGB) == len(Tag)
