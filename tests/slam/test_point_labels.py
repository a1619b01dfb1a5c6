"""Points of some labels are left out of clouds as a NumPy filter leaves them out."""

from types import SimpleNamespace

import numpy as np
import pytest

from recorder.slam.ros1.point_labels import UnlabelledError, without_labels

POINT = np.dtype([("x", "<f4"), ("label", "u1"), ("id", "<u4")])


def cloud_of(rows: np.ndarray[tuple[int], np.dtype[np.void]], field: str) -> SimpleNamespace:
    return SimpleNamespace(
        fields=[SimpleNamespace(name=field, offset=4)], point_step=POINT.itemsize, data=rows.tobytes()
    )


@pytest.mark.parametrize("labels", [(), (3,), (0, 1, 9), tuple(range(10))])
def test_clouds_without_some_labels(labels: tuple[int, ...]) -> None:
    draw = np.random.default_rng(1)
    rows = np.zeros(500, POINT)
    rows["x"], rows["label"], rows["id"] = draw.normal(size=500), draw.integers(10, size=500), range(500)
    cloud = cloud_of(rows, "label")
    without_labels(cloud, labels)
    left = rows[~np.isin(rows["label"], labels)]
    assert cloud.data == left.tobytes()
    assert (cloud.height, cloud.width, cloud.row_step) == (1, len(left), len(left) * POINT.itemsize)


def test_clouds_without_labels_are_refused() -> None:
    with pytest.raises(UnlabelledError, match="--topics standard"):
        without_labels(cloud_of(np.zeros(2, POINT), "intensity"), (3,))
