"""Two baselines: VLAD of SIFT for images, MapClosures for LiDAR."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import cv2 as untyped_cv2
import numpy as np
from scipy.cluster.vq import kmeans2, vq

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.clock import stream
from carlaloc_env.core.errors import EvaluationError, MissingDependencyError
from recorder.places.pairs import Frames

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
        found = np.concatenate([self._features(image) for image in images])
        if len(found) < WORDS:
            raise EvaluationError(f"{len(found)} features in all reference images; give {WORDS} or more")
        draw = stream(seed, "places/vocabulary").permutation(len(found))
        start = found[draw[:WORDS]]
        self._words = kmeans2(found[draw[:TRAINED]], start, iter=20, minit="matrix", missing="warn")[0]

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
        found = self._sift.detectAndCompute(image, None)[1]
        if found is None:
            return np.zeros((0, 128))
        return np.asarray(np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-12)), np.float64)


def local_maps(clouds: Sequence[Array], frames: Frames) -> list[Array]:
    """Clouds around each frame, laid by true poses into its own axes, one point a voxel, each (N, 3) [m].

    Args:
        clouds: Points of each frame in the sensor's axes [m].
        frames: The frames.
    """
    maps = []
    for number, way_m in enumerate(frames.way_m):
        to_own = transforms.invert(frames.T_world_sensor[number])
        near = np.flatnonzero(np.abs(frames.way_m - way_m) <= AROUND_M)
        points = np.concatenate(
            [transforms.apply(to_own @ frames.T_world_sensor[k], clouds[k]) for k in near.tolist()]
        )
        cell = np.floor(points / VOXEL_M).astype(np.int64)
        maps.append(points[np.unique(cell, axis=0, return_index=True)[1]])
    return maps


def check_map_closures() -> None:
    """Refuse what cannot be run.

    Raises:
        MissingDependencyError: MapClosures is not installed.
    """
    if find_spec("map_closures") is None:
        raise MissingDependencyError(
            'map_closures is not installed; install it with: pip install "carlaloc-env[places]"'
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
        for found in closures.get_closures(len(reference) + _APART + number, points):
            if found.source_id < len(reference):
                similarity[number, found.source_id] = found.number_of_inliers
    return similarity
