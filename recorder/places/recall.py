"""How well a method finds places again: recall at N, and precision against recall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError, EvaluationError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceScore:
    """Scores of one method under one pair of conditions."""

    queries: int
    """Queries with at least one true partner; others are left out of all recalls."""
    recall: dict[int, float]
    """Share of these with a true partner among the first N answers, 0–1, by N."""
    average_precision: float
    """Area under precision against recall of the first answers, sorted by similarity, 0–1."""
    recall_at_full_precision: float
    """Largest recall of first answers before the first wrong one, 0–1."""
    curve: Array
    """Recall and precision after each first answer, most similar first, shape (K, 2)."""


def score_places(
    similarity: Array, overlap: Array, *, least: float, at: Sequence[int] = (1, 5, 10)
) -> PlaceScore:
    """Scores of a matrix of similarities.

    Recall at N is that of Arandjelović et al., "NetVLAD", CVPR 2016, with overlap in place of distance. First
    answers to queries without a true partner count as wrong ones in precision.

    Args:
        similarity: Likeness of each query to each reference, −inf: no answer, shape (Q, R).
        overlap: True overlap, 0–1, shape (Q, R).
        least: Overlap from which two frames show one place.
        at: Numbers N of answers.

    Raises:
        EvaluationError: shapes differ, a similarity is not a number, or no query has a partner.
        ConfigError: the least overlap is not in 0–1, or an N is below 1.
    """
    if not 0.0 < least <= 1.0 or not at or min(at) < 1:
        raise ConfigError("a true overlap lies above 0 and at most at 1, and N at 1 or more")
    if similarity.shape != overlap.shape:
        raise EvaluationError(
            f"similarities of {similarity.shape}, queries and references {overlap.shape}; give one for each"
        )
    if np.isnan(similarity).any():
        raise EvaluationError("a similarity is not a number; give −inf where there is no answer")
    true = overlap >= least
    has_partner = true.any(axis=1)
    count = int(has_partner.sum())
    if not count:
        raise EvaluationError(f"no query overlaps a reference by {least:g}; give a smaller --overlap")
    order = np.argsort(-similarity, axis=1, kind="stable")
    answered = np.isfinite(np.take_along_axis(similarity, order, axis=1))
    hit = np.take_along_axis(true, order, axis=1) & answered
    recall = {n: float(hit[has_partner, :n].any(axis=1).mean()) for n in at}
    first = np.flatnonzero(answered[:, 0])
    first = first[np.argsort(-similarity[first, order[first, 0]], kind="stable")]
    right = np.cumsum(hit[first, 0])
    precision, along = right / np.arange(1, len(first) + 1), right / count
    wrong = np.flatnonzero(~hit[first, 0])
    flawless = int(wrong[0]) if len(wrong) else len(first)
    return PlaceScore(
        queries=count,
        recall=recall,
        average_precision=float(np.sum(precision * np.diff(along, prepend=0.0))),
        recall_at_full_precision=flawless / count,
        curve=np.column_stack([along, precision]),
    )


def similarity_of(reference: Array, query: Array) -> Array:
    """Similarity of descriptors, their negative distance, shape (Q, R).

    Args:
        reference: A descriptor a row, shape (R, D).
        query: The same of the queries, shape (Q, D).
    """
    squares = np.sum(query**2, axis=1)[:, None] + np.sum(reference**2, axis=1) - 2.0 * query @ reference.T
    return np.asarray(-np.sqrt(np.maximum(squares, 0.0)))


def read_similarity(path: Path, queries: int, references: int) -> Array:
    """Similarities out of a method's file, shape (queries, references).

    Args:
        path: An ``.npz`` with ``reference`` and ``query``, a descriptor a row, or with ``similarity``; or an
            ``.npy`` with the descriptors of all references and then of all queries.
        queries: Number of query frames.
        references: Number of reference frames.

    Raises:
        EvaluationError: the file cannot be read, lacks these arrays, or has another number of rows.
    """
    try:
        opened = np.load(path, allow_pickle=False)
        if isinstance(opened, np.ndarray):
            opened = {"reference": opened[:references], "query": opened[references:]}
        found = {name: np.asarray(rows, np.float64) for name, rows in opened.items()}
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{path} cannot be read ({error}); give an .npy or .npz of NumPy") from error
    if "similarity" in found:
        return found["similarity"]
    if not {"reference", "query"} <= set(found):
        raise EvaluationError(f"{path} has {', '.join(found) or 'nothing'}; give 'reference' and 'query'")
    for name, wanted in (("reference", references), ("query", queries)):
        if found[name].ndim != 2 or len(found[name]) != wanted:
            raise EvaluationError(
                f"{path}: '{name}' is {found[name].shape}; give a row for each of {wanted} frames"
            )
    return similarity_of(found["reference"], found["query"])
