"""A vocabulary of ORB features: a tree that DBoW2 reads, in which features find words, and its weights."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import EvaluationError
from recorder.cli.main import main
from recorder.slam.orb_vocabulary import BRANCHES, LEVELS, train_vocabulary


def pictures(count: int) -> list[U8]:
    """Blobs of noise, others in each picture."""
    noise = np.random.default_rng(3).integers(0, 256, (count, 240, 320), dtype=np.uint8)
    blurred = (cv2.GaussianBlur(picture, (0, 0), 2.0) for picture in noise)
    return [np.asarray(cv2.normalize(b, None, 0, 255, cv2.NORM_MINMAX), np.uint8) for b in blurred]  # type: ignore[call-overload]


def read(text: str) -> tuple[list[int], np.ndarray, dict[int, float], dict[int, list[int]]]:
    """Parents, bits, weights of leaves and children, as DBoW2's own reader numbers them: by lines."""
    lines = text.split("\n")
    assert lines[0].split() == [str(BRANCHES), str(LEVELS), "0", "0"]
    rows = [line.split() for line in lines[1:]]
    assert all(len(row) == 35 for row in rows)  # no empty line: it would be read as a node
    parent = [0, *(int(row[0]) for row in rows)]
    bits = np.unpackbits(
        np.array([[0] * 32, *([int(v) for v in row[2:34]] for row in rows)], np.uint8), axis=1
    )
    weights = {k: float(row[34]) for k, row in enumerate(rows, start=1) if row[1] == "1"}
    children: dict[int, list[int]] = {}
    for node, above in enumerate(parent[1:], start=1):
        assert above < node
        children.setdefault(above, []).append(node)
    return parent, bits, weights, children


def test_features_find_words_of_their_kind() -> None:
    images = pictures(4)
    parent, bits, weights, children = read(train_vocabulary(iter(images)).to_text())
    assert max(map(len, children.values())) <= BRANCHES
    assert set(weights) == set(range(1, len(parent))) - set(children)  # the leaves, and no other node
    found = [cv2.ORB_create(1000, fastThreshold=7).detectAndCompute(image, None)[1] for image in images]  # type: ignore[attr-defined]
    word_of = [[descend(np.unpackbits(d), bits, children) for d in descriptors] for descriptors in found]
    own = np.unpackbits(np.concatenate(found), axis=1)
    words = np.concatenate([np.array(w) for w in word_of])
    near = np.count_nonzero(own != bits[words], axis=1).mean()
    far = np.count_nonzero(own != bits[np.roll(words, 500)], axis=1).mean()
    assert near < 0.25 * far
    # A word's weight is ln(N / N_i) over the images in which it was found while training.
    seen = sum(words[0] in w for w in word_of)
    assert weights[int(words[0])] == pytest.approx(np.log(len(images) / seen), abs=1e-5)


def descend(feature: np.ndarray, bits: np.ndarray, children: dict[int, list[int]]) -> int:
    node = 0
    while node in children:
        below = children[node]
        node = below[int(np.argmin([np.count_nonzero(feature != bits[k]) for k in below]))]
    return node


def test_it_is_the_same_each_time() -> None:
    assert train_vocabulary(iter(pictures(2))).to_text() == train_vocabulary(iter(pictures(2))).to_text()


def test_pictures_without_features_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(EvaluationError, match="hardly any features"):
        train_vocabulary(iter([np.zeros((100, 100), np.uint8)]))
    assert main(["vocabulary", str(tmp_path), "--out", str(tmp_path / "v.txt")]) == 1
    assert "has no mav0/cam0; replay with --format" in capsys.readouterr().err
