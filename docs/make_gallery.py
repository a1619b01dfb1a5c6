"""Draw docs/gallery/, one sheet per town, and maps/*/preview.png: `python docs/make_gallery.py [TOWN ...]`.

Each shows the town from above with its lanes, route, spawn points and lights, and four street views.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from carlaloc_env.town.build import known_towns, load_town
from recorder.report.town_preview import town_sheet

GALLERY = Path(__file__).parent / "gallery"
LARGEST_BYTES = 490_000
LARGEST_PREVIEW_BYTES = 690_000


def draw(name: str, folder: Path = GALLERY, quality: str = "high") -> Path:
    """Write a town's sheet as a JPEG, as good as `LARGEST_BYTES` allow.

    Args:
        name: Town.
        folder: Where it goes.
        quality: Render quality.
    """
    sheet = cv2.cvtColor(town_sheet(load_town(name), quality=quality), cv2.COLOR_RGB2BGR)
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / f"{name}.jpg"
    for percent in range(92, 20, -3):
        _, data = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, percent])
        if len(data) <= LARGEST_BYTES:
            break
    out.write_bytes(data.tobytes())
    return out


def shrink(sheet: Path, out: Path) -> Path:
    """Write a sheet as a PNG, as large as `LARGEST_PREVIEW_BYTES` allow."""
    whole = np.asarray(cv2.imread(str(sheet)))
    for width in range(1200, 400, -80):
        small = cv2.resize(
            whole, (width, width * whole.shape[0] // whole.shape[1]), interpolation=cv2.INTER_AREA
        )
        _, data = cv2.imencode(".png", small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if len(data) <= LARGEST_PREVIEW_BYTES:
            break
    out.write_bytes(data.tobytes())
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("towns", nargs="*", help="all when left out")
    parser.add_argument("--out", type=Path, default=GALLERY, help="folder of the pictures")
    parser.add_argument("--quality", default="high", help="low, medium or high")
    arguments = parser.parse_args()
    for town in arguments.towns or known_towns():
        picture = draw(town, arguments.out, arguments.quality)
        if arguments.out == GALLERY:
            shrink(picture, known_towns()[town].with_name("preview.png"))
