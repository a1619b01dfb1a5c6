"""Two baselines: VLAD of SIFT for images, MapClosures for LiDAR.

How well a method finds places again: recall at N, and precision against recall.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2 as untyped_cv2
import numpy as np
from scipy.cluster.vq import kmeans2, vq

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.clock import stream
from carlaloc_env.core.errors import ConfigError, EvaluationError, MissingDependencyError
from recorder.laboratory.place_pairs import Frames

cv2: Any = untyped_cv2
"""OpenCV, whose stubs know arrays of one type only."""

WORDS, FEATURES, TRAINED = 64, 400, 20_000
"""Words of the vocabulary, features of an image, and features that train the vocabulary."""
_APART = 100
"""MapClosures compares no maps whose numbers lie close, as those of one moment do."""
AROUND_M, VOXEL_M = 10.0, 0.5
"""Way before and behind a frame whose clouds make its local map, and edge of its voxels [m]."""


class Vlad:
    """VLAD of RootSIFT with normalised residuals, on a vocabulary of reference images alone.

    Jégou et al., "Aggregating local descriptors into a compact image representation", CVPR 2010; RootSIFT and
    normalisation by word: Arandjelović and Zisserman, CVPR 2012 and 2013.

    Args:
        images: Grey images of the reference, each of shape (H, W).
        seed: Seed of the vocabulary.

    Raises:
        EvaluationError: the images have too few features.
    """

    def __init__(self, images: Sequence[U8], *, seed: int = 0) -> None:
        self._sift = cv2.SIFT_create(FEATURES)
        features = np.concatenate([self._features(image) for image in images])
        if len(features) < WORDS:
            raise EvaluationError(f"{len(features)} features in all reference images; give {WORDS} or more")
        draw = stream(seed, "places/vocabulary").permutation(len(features))
        start = features[draw[:WORDS]]
        self._words = kmeans2(features[draw[:TRAINED]], start, iter=20, minit="matrix", missing="warn")[0]

    def describe(self, image: U8) -> Array:
        """Descriptor of length 1, zeros for an image without features, shape (WORDS · 128,)."""
        features = self._features(image)
        sums = np.zeros_like(self._words)
        if len(features):
            word = vq(features, self._words)[0]
            np.add.at(sums, word, features - self._words[word])
        sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
        return np.asarray(sums.ravel() / max(float(np.linalg.norm(sums)), 1e-12))

    def _features(self, image: U8) -> Array:
        sift = self._sift.detectAndCompute(image, None)[1]
        if sift is None:
            return np.zeros((0, 128))
        return np.asarray(np.sqrt(sift / np.maximum(sift.sum(axis=1, keepdims=True), 1e-12)), np.float64)


def local_maps(clouds: Sequence[Array], frames: Frames) -> list[Array]:
    """Clouds around each frame, laid by true poses into its own axes, one point a voxel, each (N, 3) [m].

    Args:
        clouds: Points of each frame in the sensor's axes [m].
        frames: The frames.
    """
    maps = []
    for number, distance_m in enumerate(frames.distance_m):
        to_own = transforms.invert(frames.T_world_sensor[number])
        near = np.flatnonzero(np.abs(frames.distance_m - distance_m) <= AROUND_M)
        points = np.concatenate(
            [transforms.apply(to_own @ frames.T_world_sensor[k], clouds[k]) for k in near.tolist()]
        )
        cell = np.floor(points / VOXEL_M).astype(np.int64)
        maps.append(points[np.unique(cell, axis=0, return_index=True)[1]])
    return maps


def check_map_closures() -> None:
    """Check that MapClosures is installed and can run.

    Raises:
        MissingDependencyError: MapClosures is not installed.
    """
    if find_spec("map_closures") is None:
        raise MissingDependencyError(
            'map_closures is not installed; install it with: pip install "carlaloc[places]"'
        )


def closure_similarity(reference: Sequence[Array], query: Sequence[Array]) -> Array:
    """Inliers of MapClosures' alignments of local maps, −inf without an alignment, shape (Q, R).

    Gupta et al., "Effectively detecting loop closures using point cloud density maps", ICRA 2024.

    Args:
        reference: Local maps of the reference, which make its database.
        query: Local maps of the queries; they enter the database, too, but count for no query.

    Raises:
        MissingDependencyError: MapClosures is not installed.
    """
    check_map_closures()
    from map_closures.map_closures import MapClosures

    closures = MapClosures()
    for number, points in enumerate(reference):
        closures.get_closures(number, points)
    similarity = np.full((len(query), len(reference)), -np.inf)
    for number, points in enumerate(query):
        for closure in closures.get_closures(len(reference) + _APART + number, points):
            if closure.source_id < len(reference):
                similarity[number, closure.source_id] = closure.number_of_inliers
    return similarity


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
        arrays = {name: np.asarray(rows, np.float64) for name, rows in opened.items()}
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{path} cannot be read ({error}); give an .npy or .npz of NumPy") from error
    if "similarity" in arrays:
        return arrays["similarity"]
    if not {"reference", "query"} <= set(arrays):
        raise EvaluationError(f"{path} has {', '.join(arrays) or 'nothing'}; give 'reference' and 'query'")
    for name, wanted in (("reference", references), ("query", queries)):
        if arrays[name].ndim != 2 or len(arrays[name]) != wanted:
            raise EvaluationError(
                f"{path}: '{name}' is {arrays[name].shape}; give a row for each of {wanted} frames"
            )
    return similarity_of(arrays["reference"], arrays["query"])
