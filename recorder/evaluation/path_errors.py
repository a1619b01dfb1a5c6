"""Position errors of an estimate along its path, kept in a file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.metrics import Metric


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathErrors:
    """An estimate behind its fit, the truth, and how far they are apart, pose by pose."""

    name: str
    """Name of the estimate."""
    stamp_ns: NDArray[np.int64]
    """Times [ns], shape (N,)."""
    truth_m: Array
    """True positions [m], shape (N, 3)."""
    estimate_m: Array
    """Estimated positions behind the fit [m], shape (N, 3)."""
    error_m: Array
    """Distances between both [m], shape (N,)."""

    @staticmethod
    def of(result: EvaluationResult, name: str | None = None) -> PathErrors:
        """Errors of an evaluated estimate.

        Args:
            result: With `Metric.APE_TRANSLATION`.
            name: Another name than the estimate's own.
        """
        return PathErrors(
            name=result.estimate.name if name is None else name,
            stamp_ns=result.estimate.stamp_ns,
            truth_m=result.truth.position_m,
            estimate_m=result.estimate.position_m,
            error_m=result.values[Metric.APE_TRANSLATION],
        )

    @property
    def distance_m(self) -> Array:
        """Distance travelled since the first pose [m], shape (N,)."""
        steps = np.linalg.norm(np.diff(self.truth_m, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def leaves_truth_at_ns(self, over_s: float = 1.0) -> int:
        """Time when the estimate begins to leave the truth [ns].

        The first from which both move differently over `over_s`, by at least half of the largest difference;
        over a quarter of an estimate that is too short for it.
        """
        difference_m = self.estimate_m - self.truth_m
        over_ns = min(round(over_s * 1e9), int(np.ptp(self.stamp_ns)) // 4)
        later = np.searchsorted(self.stamp_ns, self.stamp_ns + over_ns)
        later = np.minimum(later, len(self.stamp_ns) - 1)
        apart_m = np.linalg.norm(difference_m[later] - difference_m, axis=1)
        return int(self.stamp_ns[np.argmax(apart_m >= 0.5 * apart_m.max())])

    def time_s(self, start_ns: int) -> Array:
        """Times since a stamp [s], shape (N,)."""
        return np.asarray((self.stamp_ns - start_ns) * 1e-9, np.float64)

    def save(self, path: Path) -> None:
        """Write them to a new file (.npz)."""
        with atomic_write(path, EvaluationError) as part, part.open("wb") as file:
            np.savez_compressed(file, **{field.name: getattr(self, field.name) for field in fields(self)})

    @staticmethod
    def load(path: Path) -> PathErrors:
        """Read a file that `save` wrote.

        Raises:
            EvaluationError: it cannot be read.
        """
        try:
            with np.load(path) as columns:
                return PathErrors(**{**columns, "name": str(columns["name"])})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise EvaluationError(f"cannot read {path} ({error}); evaluate the estimate again") from error
