"""Write a town's OpenDRIVE file: `python -m maps.plans.build Town03` from the repository root."""

import argparse
import importlib
import pathlib
import sys

from .authoring.builder import Builder

MAPS = pathlib.Path(__file__).resolve().parents[1]
"""Folder of the towns."""


def town_text(name: str) -> str:
    """OpenDRIVE text of a town that has a plan here."""
    module = importlib.import_module(f"maps.plans.{name.lower()}")
    return Builder(module.plan()).build()


def main() -> int:
    """Write maps/<town>/town.xodr for every town named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("town", nargs="+", help="folder below maps/ with a plan in maps/plans/")
    for name in parser.parse_args().town:
        folder = MAPS / name
        folder.mkdir(exist_ok=True)
        (folder / "town.xodr").write_text(town_text(name), encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
