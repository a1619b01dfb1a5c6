"""Consistency of covariances: NEES and its bounds over independent runs.

Poses of one run depend on each other, so every bound counts runs. Bar-Shalom, Li and Kirubarajan, Estimation
with Applications to Tracking and Navigation (2001), section 5.4.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from carlaloc_env.core.array_types import Array
from recorder.evaluation.confidence import CONFIDENCE, Interval, mean_interval, wilson

LEVELS = (0.5, 0.9, 0.95)
"""Probabilities of the ellipsoids whose coverage is counted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Consistency:
    """Comparison of stated covariances with the errors of S runs at P poses, in D dimensions."""

    nees: Array
    """Normalised error squared ξᵀ Σ⁻¹ ξ, shape (S, P); NaN where a covariance is not positive definite."""
    anees: Array
    """Mean over runs, D where covariances are right, shape (P,)."""
    bounds: Array
    """Between which `anees` lies at `CONFIDENCE` if covariances are right, (low, high)."""
    within: float
    """Share of poses at which it does; 0.95 if covariances are right."""
    scale: Interval
    """Factor by which covariances are too small (above 1) or too large: mean NEES by D."""
    noise_scale: Interval
    """The same of the scatter about the mean of the runs: without the error that all runs share."""
    axis_scale: Array
    """Factor of each variance by itself, shape (D,)."""
    coverage: dict[float, Interval]
    """Share of errors inside the ellipsoid of each of `LEVELS`; Wilson's bounds, a run being one trial."""


def consistency_of(errors: Array, covariances: Array) -> Consistency:
    """Compare errors with the covariances that were stated for them.

    Args:
        errors: Of S runs at P poses, shape (S, P, D).
        covariances: Stated for them, shape (S, P, D, D).
    """
    runs, _, dimensions = errors.shape
    whitened = _whitened(errors, covariances)
    nees = np.sum(whitened**2, axis=-1)
    anees = nees.mean(axis=0)
    bounds = anees_bounds(runs, dimensions)
    finite = np.isfinite(anees)
    scatter = np.full(runs, np.nan)
    if runs > 1:
        apart = _whitened(errors - errors.mean(axis=0), covariances)
        # The mean is the runs' own: it takes a degree of freedom.
        scatter = np.sum(apart**2, axis=-1)[:, finite].mean(axis=1) * runs / (runs - 1)
    variances = np.diagonal(covariances, axis1=-2, axis2=-1)[:, finite]
    inside = {level: np.asarray(nees[:, finite] <= chi2.ppf(level, dimensions)) for level in LEVELS}
    return Consistency(
        nees=nees,
        anees=anees,
        bounds=bounds,
        within=float(np.mean((anees[finite] >= bounds[0]) & (anees[finite] <= bounds[1]))),
        scale=mean_interval(nees[:, finite].mean(axis=1) / dimensions),
        noise_scale=mean_interval(scatter / dimensions),
        axis_scale=np.mean(errors[:, finite] ** 2 / variances, axis=(0, 1)),
        coverage={level: wilson(float(is_inside.mean()), runs) for level, is_inside in inside.items()},
    )


def anees_bounds(runs: int, dimensions: int) -> Array:
    """Bounds of the mean NEES of independent runs: runs × mean is χ² with runs × dimensions."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    return np.asarray(chi2.ppf([tail, 1.0 - tail], runs * dimensions)) / runs


def _whitened(errors: Array, covariances: Array) -> Array:
    """Errors in units of their covariances' axes, NaN where these are not positive, shape (S, P, D)."""
    values, vectors = np.linalg.eigh(covariances)
    # Against rounding: what a difference of covariances has left is no variance.
    whole = values[..., 0] > 1e-12 * values[..., -1]
    root = np.sqrt(np.where(whole[..., None], values, np.nan))
    whitened: Array = np.einsum("spij,spi->spj", vectors, errors) / root
    return whitened
