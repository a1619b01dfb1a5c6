"""Drawing of atlas cells: a canvas in sRGB with the lower left corner as origin, brought to linear light."""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.render.textures.letters import face
from carlaloc_env.render.textures.noise import Layer, with_roughness

Rgb = tuple[int, int, int]
"""sRGB colour 0–255."""
_OVERSAMPLING = 4
"""Pixels drawn for each pixel of a texture, along each axis."""


class Canvas:
    """Picture in units of its width and height (x, y in 0…1, y upwards), drawn four times too large."""

    def __init__(self, size_px: int, aspect: float, ground: Rgb) -> None:
        """Empty picture.

        Args:
            size_px: Edge of the square cell that it will fill [px].
            aspect: Width over height of the surface it is meant for; shapes are drawn undistorted on that.
            ground: Colour of the ground.
        """
        self._size_px = size_px
        high = _OVERSAMPLING * size_px
        self._width = max(round(high * min(aspect, 1.0)), 8)
        self._height = max(round(high / max(aspect, 1.0)), 8)
        self._image = np.full((self._height, self._width, 3), ground, np.uint8)
        self._gloss = np.full((self._height, self._width), 0.5, np.float32)

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self._width / self._height

    def rectangle(
        self, x0: float, y0: float, x1: float, y1: float, colour: Rgb, roughness: float | None = None
    ) -> None:
        """Filled rectangle."""
        a, b = self._pixel(x0, y1), self._pixel(x1, y0)
        cv2.rectangle(self._image, a, b, colour, -1)
        if roughness is not None:
            cv2.rectangle(self._gloss, a, b, roughness, -1)

    def shade(
        self, x0: float, y0: float, x1: float, y1: float, low: Rgb, high: Rgb, roughness: float | None = None
    ) -> None:
        """Rectangle that shades from one colour at its lower edge to another at its upper edge."""
        (left, top), (right, bottom) = self._pixel(x0, y1), self._pixel(x1, y0)
        rows = max(bottom - top, 1)
        t = np.linspace(1.0, 0.0, rows)[:, None, None]
        patch = np.asarray(low) + t * (np.asarray(high, dtype=np.float64) - np.asarray(low))
        self._image[top : top + rows, left:right] = patch.astype(np.uint8)
        if roughness is not None:
            self._gloss[top : top + rows, left:right] = roughness

    def polygon(self, points: ArrayLike, colour: Rgb) -> None:
        """Filled polygon of points (x, y)."""
        corners = np.array([self._pixel(x, y) for x, y in np.asarray(points)], dtype=np.int32)
        cv2.fillPoly(self._image, [corners], colour, cv2.LINE_AA)

    def disc(self, x: float, y: float, radius: float, colour: Rgb, squash: float = 1.0) -> None:
        """Filled circle, its radius in units of the height; `squash` scales it upwards."""
        r = radius * self._height
        axes = (max(round(r), 1), max(round(r * squash), 1))
        cv2.ellipse(self._image, self._pixel(x, y), axes, 0, 0, 360, colour, -1, cv2.LINE_AA)

    def line(self, points: ArrayLike, width: float, colour: Rgb) -> None:
        """Polyline, its width in units of the height."""
        corners = np.array([self._pixel(x, y) for x, y in np.asarray(points)], dtype=np.int32)
        cv2.polylines(self._image, [corners], False, colour, max(round(width * self._height), 1), cv2.LINE_AA)

    def text(
        self,
        words: str,
        x: float,
        y: float,
        width: float,
        height: float,
        colour: Rgb,
        letters: str = "condensed",
    ) -> None:
        """Words centred on a point, as large as fits into width and height (shares of the picture).

        Args:
            words: Text.
            x: Centre.
            y: Centre.
            width: Room for the words.
            height: Room for the capitals.
            colour: Colour.
            letters: A key of `typeface.FACES`.
        """
        drawn = face(letters)
        em = min(height * self._height / drawn.capital, width * self._width / max(drawn.width(words), 1e-6))
        left = x * self._width - 0.5 * em * drawn.width(words)
        foot = (1.0 - y) * self._height + 0.5 * em * drawn.capital
        # Sixteenths of a pixel, so that stems of one letter are equally wide.
        places = [16.0 * (ring * (em, -em) + (left, foot)) for ring in drawn.rings(words)]
        if places:
            rings = [np.rint(place).astype(np.int32) for place in places]
            cv2.fillPoly(self._image, rings, colour, cv2.LINE_AA, 4)

    def cell(self, rng: np.random.Generator, wear: float) -> Layer:
        """The finished square cell, row 0 at the bottom, with a little grain."""
        return self.patch(rng, self._size_px, self._size_px, wear)

    def patch(self, rng: np.random.Generator, width_px: int, height_px: int, wear: float) -> Layer:
        """The finished picture at any size, row 0 at the bottom, with a little grain."""
        size = (width_px, height_px)
        rgb = cv2.resize(to_linear(self._image), size, interpolation=cv2.INTER_AREA)
        gloss = cv2.resize(self._gloss, size, interpolation=cv2.INTER_AREA)
        grain = np.exp(wear * rng.standard_normal((height_px, width_px, 1), dtype=np.float32))
        return with_roughness(rgb * grain, gloss)[::-1]

    def _pixel(self, x: float, y: float) -> tuple[int, int]:
        return round(x * self._width), round((1.0 - y) * self._height)


def scaled(colour: Rgb, factor: float) -> Rgb:
    """A colour darkened or brightened by a factor, within 0–255."""
    red, green, blue = (int(np.clip(value * factor, 0, 255)) for value in colour)
    return red, green, blue


def to_linear(srgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Linear light 0–1 of sRGB bytes."""
    c = srgb.astype(np.float32) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)


def sheet(cells: list[Layer], side: int) -> Layer:
    """Atlas of square cells, cell 0 at the lower left (row 0, column 0)."""
    rows = [np.concatenate(cells[k * side : (k + 1) * side], axis=1) for k in range(side)]
    return np.concatenate(rows, axis=0)


def strips(cells: list[Layer], *, columns: int, rows: int, size_px: int) -> Layer:
    """Atlas of equal oblong cells, cell 0 at the lower left; rows that are left over stay grey."""
    out = np.full((size_px, size_px, 4), 0.3, np.float32)
    for k, cell in enumerate(cells[: columns * rows]):
        row, column = divmod(k, columns)
        height, width = cell.shape[:2]
        out[row * height : (row + 1) * height, column * width : (column + 1) * width] = cell
    return out
