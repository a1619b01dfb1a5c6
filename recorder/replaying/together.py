"""Files of all cars of a drive together, made of those of each: one bag, one scenario of OPV2V."""

from __future__ import annotations

import os
import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.files.atomic_files import part_path, remove
from recorder.dataset.layout import FORMATS, SequenceFolder
from recorder.replaying.options import ReplayConfig
from recorder.replaying.replay import ReplayResult

FOLDER = "all_cars"
"""Folder of bags of all cars, beside those of the cars."""
SCENARIOS = "opv2v"
"""Folder of scenarios: a root of OpenCOOD."""


def check_one_bag(carried: Sequence[ReplayConfig]) -> None:
    """Refuse one bag of all cars where there is nothing to join.

    Raises:
        ConfigError: there is one car, or no format of bags.
    """
    if len(carried) < 2:
        raise ConfigError("one bag of several cars needs several; give --car all, or a --roadside unit")
    if not any(FORMATS[name].is_bag for name in carried[0].formats):
        raise ConfigError(
            "one bag of several cars needs a format of bags; add rosbag1 or rosbag2 to --format"
        )


def write_together(
    out: Path,
    carried: Sequence[ReplayConfig],
    results: Mapping[ReplayConfig, ReplayResult],
    *,
    one_bag: bool,
) -> list[Path]:
    """Join what the sequences of all cars hold under one condition; files that are there already are kept.

    Args:
        out: Folder of the cars' folders.
        carried: Replay of each car and unit.
        results: What each replay has written.
        one_bag: Whether bags are joined.

    Raises:
        WriterError: a file cannot be written.
    """
    alike: dict[Path, dict[str, SequenceFolder]] = defaultdict(dict)
    for config in results if len(carried) > 1 else ():
        for path in results[config].sequences:
            place = path.relative_to(out / config.carrier)
            alike[place][config.carrier] = SequenceFolder(path)
    written = []
    for place, sequences in alike.items():
        for name in dict.fromkeys(carried[0].formats):
            places = {carrier: folder.place(name) for carrier, folder in sequences.items()}
            if FORMATS[name].is_bag and one_bag:
                target = SequenceFolder(out / FOLDER / place).place(name)
                if not target.exists():
                    from recorder.writers.ros.joined_bag import join_bags

                    join_bags(places, target, name)
                written.append(target)
            elif name == "opv2v" and len(places) > 1:
                written.append(_scenario(out / SCENARIOS / place.parent.parent, list(places.values())))
    return written


def _scenario(root: Path, folders: Sequence[Path]) -> Path:
    """One scenario of those of each agent: their common frames, as links to the same bytes."""
    scenarios = [next(path for path in folder.iterdir() if path.is_dir()) for folder in folders]
    target, agents = root / scenarios[0].name, [next(p for p in s.iterdir() if p.is_dir()) for s in scenarios]
    if target.exists():
        return target
    common = set.intersection(*({file.stem for file in agent.glob("*.yaml")} for agent in agents))
    part = part_path(target)
    try:
        remove(part)
        part.mkdir(parents=True)
        files = [file for file in scenarios[0].iterdir() if file.is_file()]
        for agent in agents:
            (part / agent.name).mkdir()
            files += [
                file for file in agent.iterdir() if file.name.partition(".")[0].partition("_")[0] in common
            ]
        for file in files:
            _link(file, part / (file.parent.name if file.parent in agents else "") / file.name)
        part.rename(target)
    except OSError as error:
        remove(part)
        raise WriterError(f"cannot write {target}: {error.strerror or error}") from error
    return target


def _link(file: Path, to: Path) -> None:
    """A second name of a file; a copy where the disk has no links."""
    try:
        os.link(file, to)
    except OSError:
        shutil.copyfile(file, to)
