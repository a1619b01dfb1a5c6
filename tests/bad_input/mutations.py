"""Damaged inputs: bytes, texts and trees of plain data with a few edits, as hypothesis draws them."""

import copy
import re
from typing import Any

import hypothesis.strategies as st

NUMBERS: list[Any] = [
    0, -1, 1, 2, 1e-9, -0.5, 90.0, 1e6, 10**9, -(10**12), 2**63, 2**64, 10**30, 1e300, float("nan"),
    float("inf"), float("-inf"),
]  # fmt: skip
TEXTS: list[Any] = [
    "", " ", "None", "nan", "../../escape", "/etc/passwd", "a/b", "..", ".", "x" * 5000, "line\nline",
    "\x00", "ä\u202e", "Town03", "%s", "{0}", "-",
]  # fmt: skip
OTHERS: list[Any] = [None, True, [], {}, [[]], [1, 2, 3], {"a": 1}, [0.0] * 1000]

VALUES = st.one_of(
    st.sampled_from([*NUMBERS, *TEXTS, *OTHERS]), st.floats(), st.integers(), st.text(max_size=20)
)
"""Values that no author of a file would write."""


def nodes(tree: Any) -> list[tuple[Any, Any]]:
    """Every place of a tree of mappings and lists: its container and key."""
    found: list[tuple[Any, Any]] = []
    waiting = [tree]
    while waiting:
        container = waiting.pop()
        keys = list(container) if isinstance(container, dict) else range(len(container))
        for key in keys:
            found.append((container, key))
            if isinstance(container[key], (dict, list)):
                waiting.append(container[key])
    return found


@st.composite
def trees(draw: st.DrawFn, seed: Any) -> Any:
    """The tree with one to three places changed, removed, renamed or doubled."""
    tree = copy.deepcopy(seed)
    for _ in range(draw(st.integers(1, 3))):
        places = nodes(tree)
        if not places:
            return tree
        container, key = places[draw(st.integers(0, len(places) - 1))]
        kind = draw(st.sampled_from(["change", "change", "change", "remove", "rename", "double"]))
        if kind == "change":
            container[key] = copy.deepcopy(draw(VALUES))
        elif kind == "remove":
            del container[key]
        elif isinstance(container, list):
            container.append(copy.deepcopy(container[key]))
        else:
            container[draw(st.text(max_size=12))] = container.pop(key)
    return tree


Splices = list[tuple[int, int, bytes]]
"""Edits of bytes, one after the other: beginning and end of what goes, and what comes in its place.

What is drawn is kept for the whole hunt, so that whole files would fill the memory.
"""


def spliced(data: bytes, splices: Splices) -> bytes:
    """The bytes after some edits."""
    for begin, end, put in splices:
        data = data[:begin] + put + data[end:]
    return data


@st.composite
def damages(draw: st.DrawFn, seed: bytes) -> Splices:
    """One to four pieces overwritten (half of them in place), inserted, cut out, or the end lost."""
    splices: Splices = []
    for _ in range(draw(st.integers(1, 4))):
        at, put = draw(st.integers(0, max(len(seed) - 1, 0))), draw(st.binary(max_size=12))
        gone = len(put) if draw(st.booleans()) else draw(st.integers(0, 40))
        splices.append((at, at + gone, put))
    if draw(st.integers(0, 9)) == 0:
        splices.append((draw(st.integers(0, len(seed))), len(seed) + 100, b""))
    return splices


@st.composite
def lines(draw: st.DrawFn, seed: str, by: str = " ") -> str:
    """The text with some words of its lines replaced, and lines doubled, swapped or dropped."""
    rows = [line.split(by) for line in seed.splitlines()]
    for _ in range(draw(st.integers(1, 6))):
        row = draw(st.integers(0, len(rows) - 1))
        kind = draw(st.sampled_from(["word", "word", "cut", "double", "swap", "drop"]))
        if kind == "word" and rows[row]:
            rows[row][draw(st.integers(0, len(rows[row]) - 1))] = str(draw(VALUES))
        elif kind == "cut":
            rows[row] = rows[row][: draw(st.integers(0, 9))]
        elif kind == "double":
            rows.insert(row, list(rows[row]))
        elif kind == "swap":
            other = draw(st.integers(0, len(rows) - 1))
            rows[row], rows[other] = rows[other], rows[row]
        elif len(rows) > 1:
            del rows[row]
    start = draw(st.sampled_from(["", "", "", "\ufeff", "# c\n", "\n\n"]))
    return start + "\n".join(by.join(words) for words in rows)


@st.composite
def attributes(draw: st.DrawFn, seed: bytes) -> Splices:
    """One to three attributes of an XML text changed to other words or numbers."""
    data, splices = seed, list[tuple[int, int, bytes]]()
    for _ in range(draw(st.integers(1, 3))):
        found = list(re.finditer(rb'="([^"]*)"', data))
        match = found[draw(st.integers(0, len(found) - 1))]
        words = st.one_of(st.sampled_from([*NUMBERS, *TEXTS]), st.floats(-1e4, 1e4), st.text(max_size=9))
        put = str(draw(words)).replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
        splices.append((match.start(1), match.end(1), put.encode("utf-8", "replace")))
        data = spliced(data, splices[-1:])
    return splices


@st.composite
def elements(draw: st.DrawFn, seed: bytes) -> Splices:
    """One to three elements below the root of an XML text cut out, doubled or moved."""
    data, splices = seed, list[tuple[int, int, bytes]]()
    for _ in range(draw(st.integers(1, 3))):
        starts = list(re.finditer(rb"<(\w+)\b[^<>]*>", data))[1:]
        match, other = (starts[draw(st.integers(0, len(starts) - 1))] for _ in range(2))
        closing = (
            None if match[0].endswith(b"/>") else re.compile(rb"</%b>" % match[1]).search(data, match.end())
        )
        begin, end = match.start(), (closing or match).end()
        kind, piece = draw(st.sampled_from(["cut", "double", "move"])), data[begin:end]
        edits = [(begin, end, b"" if kind != "double" else piece + piece)]
        if kind == "move":
            at = other.start() if other.start() < begin else max(other.start() - len(piece), begin)
            edits.append((at, at, piece))
        splices += edits
        data = spliced(data, edits)
    return splices
