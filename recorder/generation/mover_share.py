"""Share of movers: how much of what sensors see belongs to vehicles and walkers of the traffic."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from carlaloc_env.samples import PointCloud, Sample, SemanticImage
from carlaloc_env.scene.mesh import EGO_INSTANCE


class MoverShare:
    """Counts points and pixels that lie on traffic, by stream, over the labelled samples of a sequence.

    Parked cars belong to the town and do not count; whoever waits in the traffic does.
    """

    def __init__(self) -> None:
        self._all: dict[str, int] = defaultdict(int)
        self._movers: dict[str, int] = defaultdict(int)

    def count(self, sample: Sample) -> None:
        """Count a sample, if its points or pixels are labelled."""
        if isinstance(sample, (PointCloud, SemanticImage)) and sample.instance is not None:
            self._all[sample.sensor] += sample.instance.size
            self._movers[sample.sensor] += int(np.count_nonzero(sample.instance > EGO_INSTANCE))

    def shares(self) -> dict[str, float]:
        """Fraction of points or pixels on movers, 0–1, by stream."""
        return {name: round(self._movers[name] / max(self._all[name], 1), 5) for name in sorted(self._all)}
