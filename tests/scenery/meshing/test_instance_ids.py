"""The counter of instance ids."""

import pytest

from carlaloc_env.core.errors import MapError
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scenery.meshing.props import InstanceIds


def test_ids_follow_each_other_and_none_comes_twice() -> None:
    ids = InstanceIds()
    counts = (1, 3, 0, 5, 1)
    firsts = [ids.take(count) for count in counts]
    taken = [first + k for first, count in zip(firsts, counts, strict=True) for k in range(count)]
    assert taken == list(range(1, 1 + sum(counts)))


def test_static_things_stay_below_the_ego() -> None:
    ids = InstanceIds()
    ids.take(EGO_INSTANCE - 1)
    assert ids.take(0) == EGO_INSTANCE
    with pytest.raises(MapError, match="smaller map"):
        ids.take()
