"""Satellites in the sky over a drive: in sight, reflected or blocked, as a sequence's raw GNSS has them."""

from __future__ import annotations

import csv
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.samples.gnss_signals import WAYS
from recorder.dataset.sequence import SlamSequence
from recorder.writers.formats.rinex import SIGNALS

COLOURS = ((47, 211, 154), (255, 184, 28), (213, 94, 0))
"""Colours of satellites in sight, reflected and blocked."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyOverTime:
    """Satellites above the mask of E epochs, S in all."""

    stamp_ns: NDArray[np.int64]
    """Unix times of the epochs [ns], shape (E,)."""
    first: NDArray[np.int64]
    """First satellite of each epoch, and S, shape (E + 1,)."""
    name: NDArray[np.str_]
    """Names as in RINEX, shape (S,)."""
    place: Array
    """Places to the east and to the north on a plot whose horizon is a circle of radius 90, shape (S, 2)."""
    way: U8
    """Ways of their signals, by their number in `samples.gnss_signals.WAYS`, shape (S,)."""


def read_sky(sequence: SlamSequence) -> SkyOverTime | None:
    """The sky of the first receiver of a sequence; None: it has no raw GNSS.

    Raises:
        EvaluationError: the file of signals is damaged.
    """
    file = next(iter(sorted(sequence.files.place("rinex").glob(f"*{SIGNALS}"))), None)
    if file is None:
        return None
    with file.open(encoding="ascii", newline="") as text:
        rows = list(csv.DictReader(text))
    try:
        stamp_ns, first = np.unique(np.array([int(row["stamp_ns"]) for row in rows]), return_index=True)
        turn, up = np.radians(
            [[float(row[f"{name}_deg"]) for row in rows] for name in ("azimuth", "elevation")]
        )
        return SkyOverTime(
            stamp_ns=stamp_ns,
            first=np.append(first, len(rows)),
            name=np.array([row["satellite"] for row in rows]),
            place=(90.0 - np.degrees(up))[:, None] * np.stack([np.sin(turn), np.cos(turn)], axis=-1),
            way=np.array([WAYS.index(row["way"]) for row in rows], np.uint8),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise EvaluationError(f"{file} is no table of signals; replay it anew") from error
