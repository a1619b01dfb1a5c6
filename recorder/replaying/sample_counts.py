"""Counts samples of a sequence by stream, and the share of points and pixels on traffic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from carlaloc_env.samples import PointCloud, Sample, SemanticImage
from carlaloc_env.scene.mesh import EGO_INSTANCE


class SampleCounts:
    """Counts samples by stream and, of labelled ones, points and pixels that lie on traffic.

    Parked cars belong to the town and do not count; vehicles that wait in traffic do.
    """

    def __init__(self) -> None:
        self._samples: Counter[str] = Counter()
        self._all: Counter[str] = Counter()
        self._movers: Counter[str] = Counter()

    def count(self, sample: Sample) -> None:
        """Count a sample."""
        self._samples[sample.sensor] += 1
        if isinstance(sample, (PointCloud, SemanticImage)) and sample.instance is not None:
            self._all[sample.sensor] += sample.instance.size
            self._movers[sample.sensor] += int(np.count_nonzero(sample.instance > EGO_INSTANCE))

    def add(self, counts: Mapping[str, Mapping[str, int]]) -> None:
        """Add the `numbers` of another instance."""
        for mine, name in ((self._samples, "samples"), (self._all, "labelled"), (self._movers, "movers")):
            mine.update(counts[name])

    def numbers(self) -> dict[str, dict[str, int]]:
        """Samples, labelled points or pixels, and those on movers, each by stream."""
        return {"samples": dict(self._samples), "labelled": dict(self._all), "movers": dict(self._movers)}

    def samples(self) -> dict[str, int]:
        """Number of samples by stream."""
        return dict(sorted(self._samples.items()))

    def shares(self) -> dict[str, float]:
        """Fraction of points or pixels on movers, 0–1, by stream."""
        return {name: round(self._movers[name] / max(self._all[name], 1), 5) for name in sorted(self._all)}
