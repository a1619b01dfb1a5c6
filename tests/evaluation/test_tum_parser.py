"""Compiled reading of TUM files: every bit against Python's own float()."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.evaluation import trajectory_files
from recorder.evaluation.trajectory_files import read_tum
from recorder.evaluation.tum_parser import parse_tum

NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.floats(-1e4, 1e4)
FORMS = st.sampled_from([repr, "{:.9f}".format, "{:.6e}".format, "{:+.3f}".format, "{:.17g}".format])


@settings(deadline=None)
@given(numbers=st.lists(NUMBERS, min_size=7, max_size=7), form=FORMS)
def test_numbers_are_those_of_python(numbers: list[float], form: object) -> None:
    words = [form(number) for number in numbers]  # type: ignore[operator]
    found = parse_tum(f"12.5 {' '.join(words)}\n".encode())
    # More digits than 64 bits hold are left to the other reader.
    assert found is None or found[1][0].tolist() == [float(word) for word in words]


def test_regular_files_are_not_left_to_the_other_reader() -> None:
    draw = np.random.default_rng(3)
    table = draw.normal(size=(20_000, 7)) * 10.0 ** draw.integers(-30, 5, (20_000, 7))
    stamps = 1_672_531_200_000_000_000 + np.arange(20_000) * 5_000_000
    rows = zip(stamps.tolist(), table.tolist(), strict=True)
    lines = [f"{s // 10**9}.{s % 10**9:09d} " + " ".join(map(repr, row)) for s, row in rows]
    found = parse_tum(("# a comment\n\n" + "\r\n".join(lines)).encode())
    assert found is not None
    assert (found[0] == stamps).all()
    assert (found[1] == table).all()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# nothing\n",
        "1 2 3 4 5 6 7\n",
        "1 2 3 4 5 6 7 8 9\n",
        "1,2,3,4,5,6,7,8\n",
        "1 2 3 4 5 6 7 x\n",
        "1 2 3 4 5 6 7 nan\n",
        "1 2 3 4 5 6 7 1e\n",
        "1672531200000000000 0 0 0 0 0 0 1\n",
        "1.0000000001 0 0 0 0 0 0 1\n",
        "-1.0 0 0 0 0 0 0 1\n",
        "1.5 0 0 0 0 0 0 1.00000000000000000001\n",
    ],
)
def test_other_files_are_left_to_the_other_reader(text: str) -> None:
    assert parse_tum(text.encode()) is None


def test_both_readers_give_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draw = np.random.default_rng(5)
    lines = []
    for k in draw.permutation(3000):
        q = draw.normal(size=4)
        values = [*draw.normal(size=3) * 100, *q / np.linalg.norm(q)]
        lines.append(f"{1_700_000_000 + k // 7}.{k % 7}5 " + " ".join(f"{v:.15g}" for v in values))
    path = tmp_path / "a.tum"
    path.write_text("\n".join(lines))
    slow = read_tum(path)
    monkeypatch.setattr(trajectory_files, "_LONG_BYTES", 0)
    fast = read_tum(path)
    for name in ("stamp_ns", "position_m", "quat_xyzw"):
        assert (getattr(slow, name) == getattr(fast, name)).all()
