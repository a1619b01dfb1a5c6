"""Elementary functions: near the truth, like NumPy's at the edges, and the same bits without wide vectors."""

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.processes.narrow_vectors import narrow_environment

from carlaloc_env.core import elementary

WITHIN = {"sin": 1, "cos": 1, "tan": 2, "arctan": 1, "arcsin": 4, "arccos": 4, "exp": 1, "log": 1, "log10": 2}
"""Units of the last bit from the truth."""
DIGEST = """
import hashlib
import numpy as np
from carlaloc_env.core import elementary
x, y = np.random.default_rng(1).uniform(0.0, 1.0, (2, 200_000))
values = [getattr(elementary, name)(9.0 * x - 4.0) for name in ("sin", "cos", "tan", "arctan", "exp")]
values += [getattr(elementary, name)(x) for name in ("log", "log10", "arcsin", "arccos")]
values += [elementary.arctan2(x - 0.5, y - 0.5), elementary.power(x, 9.0 * y), elementary.convolve(x, y[:50])]
values += [elementary.matrix_product(x.reshape(-1, 4), y[:16].reshape(4, 4))]
print(hashlib.sha256(b"".join(v.tobytes() for v in values)).hexdigest())
"""


@pytest.mark.parametrize("name", sorted(WITHIN))
def test_within_units_of_the_last_bit_of_extended_precision(name: str) -> None:
    draw = np.random.default_rng(5)
    x = draw.uniform(0.0, 1.0, 100_000) if name[:3] in ("log", "arc") else draw.uniform(-20.0, 20.0, 100_000)
    if name == "arctan":
        x = np.tan(3.0 * x)
    truth = getattr(np, name)(x.astype(np.longdouble))
    apart = np.abs(getattr(elementary, name)(x) - truth) / np.spacing(np.abs(truth).astype(np.float64))
    assert apart.max() < WITHIN[name]


def test_angles_of_points_in_all_directions() -> None:
    values = [0.0, -0.0, 1.0, -1.0, 3e-200, -2e200, math.inf, -math.inf]
    for y in values:
        for x in values:
            found, true = float(elementary.arctan2(y, x)), math.atan2(y, x)
            assert found == pytest.approx(true, rel=3e-16)
            assert math.copysign(1.0, found) == math.copysign(1.0, true)
    assert math.isnan(elementary.arctan2(math.nan, 1.0))


def test_edges_are_those_of_the_standard() -> None:
    assert elementary.exp([math.inf, -math.inf, 710.0, -746.0, 0.0]).tolist() == [math.inf, 0, math.inf, 0, 1]
    assert elementary.log([1.0, 0.0, math.inf]).tolist() == [0.0, -math.inf, math.inf]
    assert np.isnan(elementary.log(-1.0))
    assert np.isnan(elementary.sin([math.inf, math.nan])).all()
    assert np.isnan(elementary.arccos(1.1))
    assert math.copysign(1.0, float(elementary.sin(-0.0))) == -1.0
    assert elementary.sinc([0.0, 1.0]) == pytest.approx([1.0, 0.0], abs=1e-16)
    assert elementary.sin(1e9) == pytest.approx(math.sin(1e9), abs=1e-6)


def test_powers() -> None:
    x, y = np.random.default_rng(3).uniform(0.0, 30.0, (2, 1000))
    assert elementary.power(x, y - 15.0) == pytest.approx(np.power(x, y - 15.0), rel=1e-13)
    assert elementary.power([0.0, 0.0, 5.0], [0.5, 0.0, 0.0]).tolist() == [0.0, 1.0, 1.0]


def test_single_precision_stays_single() -> None:
    x = np.linspace(-4.0, 4.0, 1001, dtype=np.float32)
    assert elementary.sin(x).dtype == np.float32
    assert elementary.sin(x) == pytest.approx(np.sin(x.astype(np.float64)), abs=6e-8)
    assert elementary.arctan2(x, 2.0 * x.astype(np.float64)).dtype == np.float64


@pytest.mark.parametrize("mode", ["full", "same", "valid"])
@pytest.mark.parametrize("shape", [(40, 5), (40, 4), (3, 8)])
def test_convolution_is_numpys(mode: str, shape: tuple[int, int]) -> None:
    draw = np.random.default_rng(2)
    a, b = draw.normal(size=shape[0]), draw.normal(size=shape[1])
    assert elementary.convolve(a, b, mode) == pytest.approx(np.convolve(a, b, mode), abs=1e-13)  # type: ignore[call-overload]


def test_matrix_product_is_numpys() -> None:
    draw = np.random.default_rng(2)
    a, b = draw.normal(size=(7, 4, 3)), draw.normal(size=(3, 2))
    assert elementary.matrix_product(a, b) == pytest.approx(a @ b, abs=1e-14)


@pytest.mark.long
def test_same_bits_without_wide_vectors(tmp_path: Path) -> None:
    digests = []
    for name, switches in (("wide", {}), ("narrow", narrow_environment())):
        settings = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / name), **switches}
        made = subprocess.run(
            [sys.executable, "-c", DIGEST], env=settings, capture_output=True, text=True, check=True
        )
        digests.append(made.stdout.strip())
    assert len(digests[0]) == len(hashlib.sha256().hexdigest())
    assert digests[0] == digests[1]
