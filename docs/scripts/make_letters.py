"""Make the letters of signs from Roboto's files: `python docs/scripts/make_letters.py FOLDER_OF_ROBOTO`.

Roboto is under the Apache licence 2.0, so that we may ship what we take of it: outlines of some
letters, their curves as short lines. fontTools reads the files; it is needed here alone.
"""

import argparse
import string
from pathlib import Path
from typing import Any

import numpy as np
from fontTools.pens.basePen import BasePen
from fontTools.ttLib import TTFont
from numpy.typing import NDArray

from carlaloc_env.render.textures.letters import FACES, LETTERS_FILE

CHARACTERS = string.ascii_letters + string.digits + " .,:;!?&'+-/%()#"
STEPS = 5
"""Lines for each curve."""
Point = tuple[float, float]


def outlines(path: Path) -> dict[str, NDArray[np.generic]]:
    """Arrays of one face, in ems: see `typeface.Face`."""
    font = TTFont(path)
    per_em = float(font["head"].unitsPerEm)
    names, glyphs = font.getBestCmap(), font.getGlyphSet()
    points: list[Point] = []
    ends, owners = [], []
    for number, character in enumerate(CHARACTERS):
        pen = _Rings(glyphs)
        glyphs[names[ord(character)]].draw(pen)
        for ring in pen.rings:
            points += ring
            ends.append(len(points))
            owners.append(number)
    return {
        "points": np.array(points, np.float32) / per_em,
        "ends": np.array(ends, np.int32),
        "owners": np.array(owners, np.int32),
        "advances": np.array([glyphs[names[ord(c)]].width for c in CHARACTERS], np.float32) / per_em,
        "capital": np.array(font["OS/2"].sCapHeight / per_em, np.float32),
    }


class _Rings(BasePen):  # type: ignore[misc]
    """Collects closed rings of points."""

    def __init__(self, glyphs: Any) -> None:
        super().__init__(glyphs)
        self.rings: list[list[Point]] = []

    def _moveTo(self, pt: Point) -> None:
        self.rings.append([pt])

    def _lineTo(self, pt: Point) -> None:
        self.rings[-1].append(pt)

    def _qCurveToOne(self, pt1: Point, pt2: Point) -> None:
        x, y = np.array([self.rings[-1][-1], pt1, pt2]).T
        for t in np.arange(1, STEPS + 1) / STEPS:
            weights = np.array([(1 - t) ** 2, 2 * t * (1 - t), t**2])
            self.rings[-1].append((float(np.sum(weights * x)), float(np.sum(weights * y))))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    arrays: dict[str, NDArray[np.generic]] = {"characters": np.array(list(CHARACTERS))}
    for face, file in FACES.items():
        for name, value in outlines(folder / file).items():
            arrays[f"{face}.{name}"] = value
    np.savez_compressed(LETTERS_FILE, **arrays)  # type: ignore[arg-type]
