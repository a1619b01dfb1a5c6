"""Tables take the types of their columns from annotations, which numpy shows differently from 2.5 on."""

from typing import Annotated

import numpy as np
import pytest

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.traffic.tables.record_arrays import Flags, columns, fill


class Row:
    """One column of each kind."""

    speed_mps: Array
    lane: Index
    waits: Flags
    corners_m: Annotated[Array, 4, 2]


def test_columns_have_the_types_and_shapes_of_their_annotations() -> None:
    """And begin as zeros."""
    table = columns(Row, 3)
    assert table.speed_mps.dtype == np.float64
    assert table.lane.dtype == np.intp
    assert table.waits.dtype == np.bool_
    assert table.corners_m.dtype == np.float64
    assert table.corners_m.shape == (3, 4, 2)
    assert not table.corners_m.any()


def test_unknown_columns_are_refused() -> None:
    """A column that the class does not have is a mistake of the caller."""
    with pytest.raises(TypeError, match="Row has no columns colour"):
        fill(Row, 1, speed_mps=1.0, lane=0, waits=False, corners_m=0.0, colour=3)
