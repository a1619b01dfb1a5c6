"""Surfaces that pass over tiles of a picture, against those that a box meets."""

import numpy as np
import pytest

from carlaloc_env.sensors.imaging.frame_motion import passing_surfaces


@pytest.mark.parametrize(("du", "dv"), [(0.3, 0.0), (37.0, 0.0), (-21.5, 13.0), (4.0, -30.0)])
def test_tiles_that_a_surface_passes_over_are_those_that_it_meets(du: float, dv: float) -> None:
    """A near box of 5 × 11 px: all tiles that it sweeps over, and none that are 3 px beside its way."""
    field = np.zeros((96, 192, 4), np.float32)
    field[...] = (0.0, 0.0, 1.0, 50.0)
    y, x = slice(40, 51), slice(90, 95)
    field[y, x] = (du, dv, 1.0, 10.0)
    near = passing_surfaces(field)[..., 3] == 10.0
    met, around = np.zeros((2, *near.shape), bool)
    for share in np.linspace(0, 1, 400):
        for rim, tiles in ((0.5, met), (3.0, around)):
            # Between steps of 4 px at most a slanting way is boxed in.
            left, right = 90 + share * du - rim, 94 + share * du + rim
            top, bottom = 40 + share * dv - rim, 50 + share * dv + rim
            tiles[int(top // 8) : int(bottom // 8) + 1, int(left // 8) : int(right // 8) + 1] = True
    assert met.any()
    assert not (met & ~near).any()
    assert not (near & ~around).any()
