"""Wires of overhead lines against the catenary."""

import numpy as np
import pytest

from carlaloc_env.scenery.structures.power_lines import catenary_m


def test_wires_hang_as_catenaries() -> None:
    """z = c·cosh(x/c): a level span sags by c·(cosh(L/2c) − 1), and z″ = √(1 + z′²)/c on any span."""
    c, length = 210.0, 40.0
    x = np.linspace(0.0, 1.0, 2001)
    level = catenary_m(length, 0.0, c, x)
    assert level[0] == pytest.approx(0.0, abs=1e-9)
    assert level[-1] == pytest.approx(0.0, abs=1e-9)
    assert -level.min() == pytest.approx(c * (np.cosh(length / 2 / c) - 1.0), rel=1e-9)
    rising = catenary_m(length, 3.0, c, x)
    assert rising[-1] == pytest.approx(3.0, rel=1e-9)
    h = length / 2000
    first, second = np.gradient(rising, h)[2:-2], np.gradient(np.gradient(rising, h), h)[2:-2]
    np.testing.assert_allclose(second * c, np.sqrt(1.0 + first**2), rtol=1e-4)
