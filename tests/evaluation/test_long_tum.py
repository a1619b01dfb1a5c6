"""Long TUM files, which Arrow reads: every bit as in the reading line by line."""

from pathlib import Path

import numpy as np
import pytest

from recorder.evaluation import text_tables
from recorder.evaluation.trajectory_files import read_tum

pytest.importorskip("pyarrow")


@pytest.fixture(autouse=True)
def all_are_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_tables, "_LONG_BYTES", 0)


@pytest.fixture
def line_by_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reading line by line is forbidden."""

    def forbidden(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(text_tables.TextTable, "rows", forbidden)


def _written(folder: Path, text: str) -> Path:
    (folder / "a.tum").write_bytes(text.encode())
    return folder / "a.tum"


def _of_python(text: str) -> tuple[list[int], list[list[float]]]:
    rows = [line.split() for line in text.splitlines() if line and line[0] != "#"]
    stamps = [int(s) * 10**9 + int(f.ljust(9, "0")) for s, _, f in (row[0].partition(".") for row in rows)]
    return stamps, [[float(word) for word in row[1:4]] for row in rows]


@pytest.mark.usefixtures("line_by_line")
@pytest.mark.parametrize("form", ["{!r}", "{:.9f}", "{:.6e}", "{:.17g}", "{:.40f}"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_stamps_and_numbers_are_those_of_python(tmp_path: Path, form: str, end: str) -> None:
    draw = np.random.default_rng(3)
    # In order, since jumps are looked up line by line.
    table = np.sort(draw.normal(size=(3000, 3)) * 10.0 ** draw.integers(-30, 5, (3000, 3)), axis=0)
    stamps = np.sort(draw.choice(9 * 10**18, 3000, replace=False)).tolist()
    words = [f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in stamps]
    words[1::2] = [word[:-3] for word in words[1::2]]
    lines = [f"{s} " + " ".join(map(form.format, row)) for s, row in zip(words, table.tolist(), strict=True)]
    text = end.join(["# a comment", "#", *(f"{line} 0 0 0 1" for line in lines)])
    read = read_tum(_written(tmp_path, text))
    assert (read.stamp_ns.tolist(), read.position_m.tolist()) == _of_python(text)
