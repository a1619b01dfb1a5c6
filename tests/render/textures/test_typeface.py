"""Letters of signs: areas and widths against the typeface's own numbers."""

import cv2
import numpy as np
import pytest

from carlaloc_env.assets.texture_atlas import BILLBOARDS, SHOP_NAMES
from carlaloc_env.render.textures.canvas import Canvas
from carlaloc_env.render.textures.letters import FACES, face

WHITE, BLACK = (255, 255, 255), (0, 0, 0)


@pytest.mark.parametrize("name", FACES)
def test_a_letter_covers_the_area_of_its_rings(name: str) -> None:
    """Area of rings by the shoelace formula, holes turn the other way, against pixels drawn."""
    letters = face(name)
    scale = 400.0
    for character in "AB8&O":
        rings = letters.rings(character)
        area = abs(sum(_area(ring) for ring in rings)) * scale**2
        picture = np.zeros((640, 640), np.uint8)
        corners = [np.rint(ring * (scale, -scale) + (60, 500)).astype(np.int32) for ring in rings]
        cv2.fillPoly(picture, corners, 1)
        assert picture.sum() == pytest.approx(area, rel=0.04)


@pytest.mark.parametrize("name", FACES)
def test_capitals_stand_on_the_line_and_are_as_tall_as_the_face_says(name: str) -> None:
    letters = face(name)
    heights = np.concatenate([ring[:, 1] for ring in letters.rings("HEITX")])
    assert heights.min() == pytest.approx(0.0, abs=1e-6)
    assert heights.max() == pytest.approx(letters.capital, abs=1e-3)
    one, many = letters.width("H"), letters.width("HHHH")
    assert many == pytest.approx(4 * one)


def test_words_fill_their_room_and_no_more() -> None:
    """The longer side decides: width of a long word, height of a short one."""
    for words, width, height in (("SPEED LIMIT", 0.8, 0.5), ("P", 0.9, 0.4)):
        c = Canvas(256, 1.0, WHITE)
        c.text(words, 0.5, 0.5, width, height, BLACK)
        ink = c.cell(np.random.default_rng(0), 0.0)[..., 0] < 0.4
        rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
        assert np.ptp(columns) <= width * 256 + 1
        assert np.ptp(rows) <= height * 256 + 1
        assert np.ptp(columns) > 0.94 * width * 256 or np.ptp(rows) > 0.94 * height * 256
        assert rows.mean() == pytest.approx(128, abs=3)


def test_every_sign_can_be_written() -> None:
    words = [text for pair in SHOP_NAMES for text in pair] + [text for row in BILLBOARDS for text in row[:2]]
    for name in FACES:
        assert min(face(name).width(text) for text in words if text) > 0.3


def _area(ring: np.ndarray) -> float:
    x, y = ring.astype(np.float64).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
