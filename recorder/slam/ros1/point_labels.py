"""Takes points of some labels out of clouds, without NumPy, which the system's Python may lack."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any

_KEPT_RUN = re.compile(rb"\x01+")


class UnlabelledError(Exception):
    """Clouds have no labels by which points could be left out."""


def without_labels(cloud: Any, labels: Collection[int]) -> None:
    """Take the points of some labels out of a `sensor_msgs/PointCloud2`, in place.

    Args:
        cloud: The message.
        labels: Values of its field ``label``, one byte.

    Raises:
        UnlabelledError: it has no such field.
    """
    offsets = [field.offset for field in cloud.fields if field.name == "label"]
    if not offsets:
        raise UnlabelledError("the bag's clouds have no labels; replay with --topics standard for seg clouds")
    step, data = cloud.point_step, bytes(cloud.data)
    kept = data[offsets[0] :: step].translate(bytes(value not in labels for value in range(256)))
    runs = [run.span() for run in _KEPT_RUN.finditer(kept)]
    cloud.data = b"".join(data[first * step : end * step] for first, end in runs)
    cloud.height, cloud.width = 1, len(cloud.data) // step
    cloud.row_step = len(cloud.data)
