"""Reads text with a row of numbers in each line: its separator, the names of its columns, and its numbers."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text

_LONG_BYTES = 500_000
"""Shorter files are not worth the loading of Arrow."""
_HEAD_CHARACTERS, _SAMPLE_ROWS = 100_000, 200
_COLUMNS_MIN = 4
"""No table of poses has fewer: a time, a position."""
_GROUPS = {"q": ("qx", "qy", "qz", "qw"), "p": ("px", "py", "pz")}
"""Columns of the groups that headers of OpenVINS name: `# timestamp(s) q p v bg ba …`."""
_COMMENTS = ("#", "%", "//")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TextTable:
    """A file of numbers, of which the beginning has been looked at."""

    path: Path
    """The file."""
    separator: str | None
    """What stands between columns; None: blanks and tabs; ``", "``: those and commas."""
    decimal_comma: bool
    """Whether commas are decimal points."""
    names: tuple[str, ...] | None
    """Names of the columns, if a header has as many."""
    first_names: tuple[str, ...]
    """Names in a header that has fewer than there are columns; groups are written out."""
    title: str | None
    """A header that is no comment."""
    begin: int
    """Lines before the first row."""
    count: int
    """Columns of the first row."""
    sample: Array
    """The first rows that have as many columns, NaN where there is no number, shape (N, count)."""

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Number of each line with numbers, and its words."""
        lines = read_text(self.path, "trajectory", EvaluationError).split("\n")
        for number, line in enumerate(lines[self.begin :], start=self.begin + 1):
            if (stripped := line.strip()) and not stripped.startswith(_COMMENTS):
                yield number, _words(stripped, self.separator, decimal_comma=self.decimal_comma)

    def read(
        self,
        values: Sequence[int],
        form: str,
        *,
        stamp: int | None,
        decimals: int = 0,
        nanosecond: int | None = None,
    ) -> tuple[NDArray[np.int64], Array]:
        """Times [ns], shape (N,), every digit of them counted, and other columns, shape (N, M).

        Args:
            values: The other columns.
            form: What a row should be, for errors.
            stamp: Column of the times; None: there is none, and they are 0.
            decimals: Digits from the unit of the times to nanoseconds: 9 for seconds, 0 for nanoseconds.
            nanosecond: Column of nanoseconds that are added to the times.

        Raises:
            EvaluationError: a row has other columns, or a word there is no number.
        """
        if stamp is not None and nanosecond is None:
            quick = self._by_arrow(stamp, values, decimals)
            if quick is not None:
                return quick
        stamps: list[int] = []
        table: list[list[float]] = []
        for number, words in self.rows():
            try:
                at_ns = 0 if stamp is None else round(Decimal(words[stamp]).scaleb(decimals))
                stamps.append(at_ns if nanosecond is None else at_ns + int(words[nanosecond]))
                table.append([float(words[column]) for column in values])
                fits = len(words) == self.count and -(2**63) <= stamps[-1] < 2**63
            except (ValueError, IndexError, InvalidOperation, OverflowError):
                fits = False
            if not fits:
                raise EvaluationError(
                    f"{self.path} line {number} is not '{form}'; give a TUM, KITTI or EuRoC file"
                )
        return np.array(stamps, dtype=np.int64), np.array(table, dtype=np.float64).reshape(len(table), -1)

    def _by_arrow(
        self, stamp: int, values: Sequence[int], decimals: int
    ) -> tuple[NDArray[np.int64], Array] | None:
        """The same by Arrow's reader, twenty times as fast and as exact.

        Returns:
            None: the file is short, Arrow is not installed, or a row is no plain one: another number of
            columns, two blanks, a comment, a time with further decimals or before 0.
        """
        try:
            if self.path.stat().st_size < _LONG_BYTES:
                return None
            from pyarrow import csv, decimal128, float64

            names = [str(column) for column in range(self.count)]
            wanted = [names[stamp], *(names[column] for column in values)]
            types = {name: float64() for name in wanted} | {names[stamp]: decimal128(28, decimals)}
            table = csv.read_csv(
                self.path,
                read_options=csv.ReadOptions(column_names=names, skip_rows=self.begin),
                parse_options=csv.ParseOptions(delimiter=self.separator or " "),
                convert_options=csv.ConvertOptions(
                    column_types=types, include_columns=wanted, null_values=[],
                    decimal_point="," if self.decimal_comma else ".",
                ),
            )  # fmt: skip
        except (ImportError, OSError, ValueError, TypeError):
            return None
        # A decimal is an integer of 128 bits: low half, high half.
        buffer = table[names[stamp]].combine_chunks().buffers()[1]
        low, high = np.frombuffer(buffer, dtype=np.int64).reshape(-1, 2).T
        if high.any() or (low < 0).any():
            return None
        columns = [table[name].to_numpy() for name in wanted[1:]]
        return low.copy(), np.stack(columns, axis=1) if columns else np.empty((len(low), 0))


def read_table(path: Path) -> TextTable:
    """Look at the beginning of a file of numbers.

    Raises:
        EvaluationError: the file is missing, no text or without a row.
    """
    lines = _head(path)
    begin, header, title = _beginning(lines)
    if begin == len(lines):
        raise EvaluationError(f"{path} holds no pose")
    first = lines[begin].strip()
    separator, decimal_comma = _separator(first)
    words = _words(first, separator, decimal_comma=decimal_comma)
    rows = (
        _words(line.strip(), separator, decimal_comma=decimal_comma)
        for line in lines[begin : begin + _SAMPLE_ROWS]
    )
    numbers = [[_number(word) for word in row] for row in rows if len(row) == len(words)]
    return TextTable(
        path=path,
        separator=separator,
        decimal_comma=decimal_comma,
        names=None if header is None else _names(header, separator, words),
        first_names=() if header is None else _first_names(header, len(words)),
        title=title,
        begin=begin,
        count=len(words),
        sample=np.array(numbers, dtype=np.float64).reshape(-1, len(words)),
    )


def _head(path: Path) -> list[str]:
    try:
        if path.stat().st_size >= _LONG_BYTES:
            with path.open(encoding="utf-8-sig", errors="replace") as file:
                lines = (head := file.read(_HEAD_CHARACTERS)).split("\n")
                # The last one may be cut.
                return lines[:-1] if len(head) == _HEAD_CHARACTERS else lines
    except OSError:
        pass
    return read_text(path, "trajectory", EvaluationError).split("\n")


def _beginning(lines: Sequence[str]) -> tuple[int, str | None, str | None]:
    """Lines before the first row, the header nearest to it, and the one that is no comment."""
    header: str | None = None
    title: str | None = None
    for number, line in enumerate(lines):
        stripped = line.strip()
        if stripped.startswith(_COMMENTS):
            header = stripped.lstrip("#%/ \t")
        elif stripped and (title is not None or any(map(_is_number, re.split(r"[,;\s]+", stripped)))):
            return number, header, title
        elif stripped:
            header = title = stripped
    return len(lines), header, title


def _separator(line: str) -> tuple[str | None, bool]:
    """Separator of a row, and whether its commas are decimal points."""
    commas_alone = "," in line and "." not in line
    if ";" in line:
        return ";", commas_alone
    tab = "\t" if line.count("\t") >= _COLUMNS_MIN - 1 else None
    words = line.split()
    if commas_alone and len(words) >= _COLUMNS_MIN and all(re.fullmatch(r"[^,]+(,[^,]+)?", w) for w in words):
        return tab, True
    if "," in line:
        return ("," if line.count(",") >= _COLUMNS_MIN - 1 else ", "), False
    return tab, False


def _words(line: str, separator: str | None, *, decimal_comma: bool = False) -> list[str]:
    if decimal_comma:
        line = line.replace(",", ".")
    if separator is None or separator == ", ":
        return (line.replace(",", " ") if separator else line).split()
    return [word.strip(' \t"') for word in line.split(separator)]


def _names(header: str, separator: str | None, row: list[str]) -> tuple[str, ...] | None:
    """Names in a header, which may use another separator than the rows do; rows may end in empty columns."""
    bare = _bare(header)
    filled = max((place for place, word in enumerate(row, start=1) if word), default=0)
    for words in (_words(bare, separator), re.split(r"[,;\s]+", bare)):
        if filled <= len(words) <= len(row):
            return (*words, *[""] * (len(row) - len(words)))
    return None


def _bare(header: str) -> str:
    """A header whose units have no blanks."""
    return re.sub(r"\s*[\[(][^\])]*[\])]", lambda unit: unit[0].replace(" ", ""), header)


def _first_names(header: str, count: int) -> tuple[str, ...]:
    """Names of the first columns; OpenVINS' groups have several, and its header ends by a row of lists."""
    words = re.split(r"[,;\s]+", _bare(header))
    if {"q", "p"} <= set(words):
        last = max(place for place, word in enumerate(words) if word in _GROUPS)
        words = [name for word in words[: last + 1] for name in _GROUPS.get(word, (word,))]
    return tuple(words) if len(words) < count else ()


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")


def _is_number(word: str) -> bool:
    return not np.isnan(_number(word)) or word.lower() == "nan"
