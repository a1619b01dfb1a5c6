"""Letters of signs: outlines of Roboto (© 2015 Google, Apache licence 2.0, LICENSE-roboto.txt beside this).

`docs/scripts/make_letters.py` makes letters.npz from Roboto's files.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LETTERS_FILE = Path(__file__).with_name("letters.npz")
FACES = {
    "bold": "Roboto-Bold.ttf",
    "black": "Roboto-Black.ttf",
    "medium": "Roboto-Medium.ttf",
    "italic": "Roboto-MediumItalic.ttf",
    "condensed": "RobotoCondensed-Bold.ttf",
}
"""Names of faces, and the files that they are from."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Face:
    """Outlines of the letters of one face, in ems, y upwards from the line they stand on."""

    number: dict[str, int]
    """Number of each character."""
    points: NDArray[np.float32]
    """Corners of all rings, shape (P, 2); ink is what an odd number of rings is round."""
    ends: NDArray[np.int32]
    """Where each ring ends among the corners, shape (R,)."""
    owners: NDArray[np.int32]
    """Character that each ring belongs to, shape (R,)."""
    advances: NDArray[np.float32]
    """How far the next letter is from each, shape (C,)."""
    capital: float
    """Height of capitals."""

    def width(self, words: str) -> float:
        """Length of a line."""
        return float(sum(self.advances[self.number[c]] for c in words))

    def rings(self, words: str) -> list[NDArray[np.float32]]:
        """Rings of a line that begins at the origin, each of shape (K, 2).

        Raises:
            KeyError: a character that the face does not have.
        """
        begin = np.concatenate([[0], self.ends[:-1]])
        outlines, x = [], 0.0
        for character in words:
            number = self.number[character]
            for ring in np.flatnonzero(self.owners == number):
                outlines.append(self.points[begin[ring] : self.ends[ring]] + np.array([x, 0.0], np.float32))
            x += float(self.advances[number])
        return outlines


@cache
def face(name: str) -> Face:
    """The face of one of the names in `FACES`."""
    with np.load(LETTERS_FILE) as file:
        arrays = {key.split(".")[1]: file[key] for key in file.files if key.startswith(f"{name}.")}
        characters = file["characters"]
    capital = float(arrays.pop("capital"))
    return Face(number={str(c): k for k, c in enumerate(characters)}, capital=capital, **arrays)
