"""Masks the movers of labelled images, and paints them over."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import cv2 as untyped_cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from recorder.dataset.bag_messages import messages, stamp_ns
from recorder.dataset.readings import StereoPair

cv2: Any = untyped_cv2
"""OpenCV; its stubs know arrays of a single type."""
MARGIN_PX = 4
"""Width of the rim around a mover that is painted over, too: features look at their surroundings [px]."""
SHRINK = 4
"""Factor by which pictures are reduced for inpainting: it must be smooth, not sharp."""
Mask: TypeAlias = tuple[int, NDArray[np.bool_]]
"""Unix time of an image [ns], and where it shows movers, shape (H, W)."""


def mover_masks(bag: Path, topic: str) -> Iterator[Mask]:
    """Masks of the labelled images of a topic.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of images whose values are semantic tags.
    """
    for message in messages(bag, topic):
        image = np.asarray(message.data).reshape(message.height, message.step)[:, : message.width]
        yield stamp_ns(message), mask_of(image)


def mask_of(tags: U8) -> NDArray[np.bool_]:
    """Mask of the movers in an image of semantic tags, with a rim of `MARGIN_PX`, shape (H, W)."""
    rim = np.ones((2 * MARGIN_PX + 1, 2 * MARGIN_PX + 1), np.uint8)
    movers = np.isin(tags, np.array(sorted(DYNAMIC_TAGS), np.uint8)).astype(np.uint8)
    return np.asarray(cv2.dilate(movers, rim) > 0)


def pairs_without_movers(
    pairs: Iterator[StereoPair], left: Iterator[Mask], right: Iterator[Mask]
) -> Iterator[StereoPair]:
    """Pairs of `without_movers`, by masks that come in the order of time.

    Args:
        pairs: Pairs of images.
        left: Masks of the left images; those of other times are passed over.
        right: Masks of the right images.
    """
    for pair in pairs:
        yield movers_painted_over(pair, *(_of_stamp(masks, pair.stamp_ns) for masks in (left, right)))


def movers_painted_over(pair: StereoPair, left: NDArray[np.bool_], right: NDArray[np.bool_]) -> StereoPair:
    """A pair in which movers are painted over in the tones around them, with the mask of the left image.

    Systems without masks find few features in smooth paint; systems with masks get them.
    """
    return replace(
        pair, left=painted_over(pair.left, left), right=painted_over(pair.right, right), left_mover=left
    )


def _of_stamp(masks: Iterator[Mask], stamp_ns: int) -> NDArray[np.bool_]:
    for mask_ns, mask in masks:
        if mask_ns == stamp_ns:
            return mask
    raise EvaluationError(f"no labelled image of {stamp_ns}; replay cameras with the output semantic")


def painted_over(image: U8, mask: NDArray[np.bool_]) -> U8:
    """An image whose masked part is filled smoothly from its rim (Telea 2004), shape (H, W)."""
    if not mask.any():
        return image
    height, width = image.shape
    small = (max(width // SHRINK, 1), max(height // SHRINK, 1))
    coarse = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    hole = cv2.resize(mask.astype(np.uint8) * 255, small, interpolation=cv2.INTER_AREA) > 0
    paint = cv2.inpaint(coarse, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    smooth = cv2.resize(paint, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.where(mask, smooth, image), np.uint8)
