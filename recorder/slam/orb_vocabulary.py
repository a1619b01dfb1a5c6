"""A vocabulary of ORB features, trained on a dataset's own images, in the text format of DBoW2.

ORB-SLAM3 does not start without a vocabulary. The one of its authors (``ORBvoc.txt``, 139 MB) is better where
loops are closed; where they are not, as in the benchmark, words only serve to match neighbouring images.
The tree is that of Gálvez-López and Tardós (T-RO 2012): k-majority on bits, level by level.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2 as untyped_cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write

cv2: Any = untyped_cv2
"""OpenCV, whose stubs know arrays of one type only."""

BRANCHES, LEVELS = 10, 5
"""Children of a node and depth of the tree: 10⁵ words at most."""
FEATURES = 1000
"""Features of an image."""
_ROUNDS = 10
"""Rounds of k-majority at most; DBoW2 continues until nothing changes, which differs little after these."""
_BITS_OF = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.uint8)
"""Number of ones of each byte."""


@dataclass(slots=True)
class Vocabulary:
    """A tree of binary descriptors; node 0 is the root, children come after their parents."""

    parent: list[int] = field(default_factory=lambda: [0])
    """Parent of each node."""
    descriptor: list[U8] = field(default_factory=lambda: [np.zeros(32, np.uint8)])
    """Descriptor of each node, shape (32,)."""
    weight: dict[int, float] = field(default_factory=dict)
    """Inverse document frequency of each leaf, by its node: a word."""

    def to_text(self) -> str:
        """DBoW2's text: branches, levels, scoring L1, weighting TF-IDF; then a line for each node."""
        lines = [f"{BRANCHES} {LEVELS} 0 0"]
        for node in range(1, len(self.parent)):
            bits = " ".join(map(str, self.descriptor[node].tolist()))
            leaf = int(node in self.weight)
            lines.append(f"{self.parent[node]} {leaf} {bits} {self.weight.get(node, 0.0):.6g}")
        # A line feed at the end would be read as one more node.
        return "\n".join(lines)


def train_vocabulary(
    images: Iterator[U8], *, seed: int = 0, progress: Callable[[int], None] = lambda _: None
) -> Vocabulary:
    """Vocabulary of the ORB features of some images.

    Args:
        images: Grey images, shape (H, W).
        seed: Seed of the first guesses of centres.
        progress: Called with the number of images read.

    Raises:
        EvaluationError: the images have fewer features than the tree has branches.
    """
    orb = cv2.ORB_create(FEATURES, fastThreshold=7)
    of_images: list[U8] = []
    for count, image in enumerate(images, start=1):
        _, descriptors = orb.detectAndCompute(image, None)
        if descriptors is not None:
            of_images.append(descriptors)
        progress(count)
    if sum(map(len, of_images)) < BRANCHES:
        raise EvaluationError("the images have hardly any features; give sequences with pictures by day")
    image_of = np.repeat(np.arange(len(of_images)), [len(d) for d in of_images])
    return _tree(np.concatenate(of_images), image_of, np.random.default_rng(seed))


def _tree(descriptors: U8, image_of: NDArray[np.int64], rng: np.random.Generator) -> Vocabulary:
    images = int(image_of[-1]) + 1
    made = Vocabulary()
    # Nodes still to be divided: number, level, and the rows of their descriptors.
    waiting = deque([(0, 0, np.arange(len(descriptors)))])
    while waiting:
        node, level, rows = waiting.popleft()
        for centre, members in _clusters(descriptors, rows, rng):
            child = len(made.parent)
            made.parent.append(node)
            made.descriptor.append(centre)
            if level + 1 == LEVELS or len(members) == 1:
                made.weight[child] = float(np.log(images / len(set(image_of[members].tolist()))))
            else:
                waiting.append((child, level + 1, members))
    return made


def _clusters(
    descriptors: U8, rows: NDArray[np.int64], rng: np.random.Generator
) -> list[tuple[U8, NDArray[np.int64]]]:
    """Centres and rows of at most `BRANCHES` clusters by k-majority, as k-means with Hamming distances."""
    features = descriptors[rows]
    if len(rows) <= BRANCHES:
        return [(features[k], rows[k : k + 1]) for k in range(len(rows))]
    centres = features[rng.choice(len(rows), BRANCHES, replace=False)]
    nearest = np.full(len(rows), -1)
    for _ in range(_ROUNDS):
        distance = [_BITS_OF[features ^ centre].sum(axis=1, dtype=np.int64) for centre in centres]
        moved = np.argmin(distance, axis=0)
        if np.array_equal(moved, nearest):
            break
        nearest = moved
        for k in range(BRANCHES):
            members = features[nearest == k]
            if len(members):
                ones = np.unpackbits(members, axis=1).sum(axis=0, dtype=np.int64)
                centres[k] = np.packbits(2 * ones > len(members))
    return [(centres[k], rows[nearest == k]) for k in range(BRANCHES) if (nearest == k).any()]


def write_vocabulary(
    data: Path, out: Path, *, images: int = 150, progress: Callable[[float, float], None] = lambda *_: None
) -> int:
    """Train a vocabulary on evenly chosen left images of all sequences below a folder; the number of words.

    Args:
        data: Folder with sequences.
        out: Text file to write.
        images: How many images at most.
        progress: Called with the images read and their total.

    Raises:
        EvaluationError: there are no images, or they have hardly any features.
    """
    files = sorted(data.rglob("mav0/cam0/data/*.png"))
    if not files:
        raise EvaluationError(f"{data} has no mav0/cam0; replay with --format rosbag1,euroc")
    chosen = [files[k] for k in np.unique(np.linspace(0, len(files) - 1, images).astype(int))]

    read = (cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in chosen)
    vocabulary = train_vocabulary(
        (image for image in read if image is not None), progress=lambda count: progress(count, len(chosen))
    )
    with atomic_write(out) as part:
        part.write_text(vocabulary.to_text(), encoding="ascii")
    return len(vocabulary.weight)
