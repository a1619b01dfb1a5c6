"""Mutated maps: the reader answers with a map or with a MapError, in time, and with nothing else."""

import re

import hypothesis.strategies as st
from hypothesis import HealthCheck, given, settings
from robustness.hunt import deadline
from shared_fixtures.worlds.maps import CROSSING

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.checks.report import report
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.opendrive.reader import read_opendrive

SEED = CROSSING.read_bytes()
NUMBER = re.compile(rb'"(-?\d[\d.e+-]*)"')
ATTRIBUTE = re.compile(rb' [A-Za-z]+="[^"]*"')
ELEMENT = re.compile(rb"<(\w+)\b[^<>]*(?:/>|>)")
VALUES = [
    b"", b"0", b"-0", b"1", b"-1", b"2", b"100", b"-3", b"0.5", b"1e-300",
    b"-1e-9", b"1e5", b"999999", b"1e6",
    b"1e7", b"1e12", b"1e300", b"nan", b"inf", b"-inf", b"abc", b"1_0", b"0x10", b"start", b"end", b"driving",
    b"junction", b"1001", b"&#0;", b"&lt;", b"\xc3\xa9", b"\xff",
]  # fmt: skip
RUNS = settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)


def must_answer(data: bytes) -> None:
    with deadline():
        try:
            xodr = read_opendrive(data)
            network = build_network(xodr)
            report(xodr, network)
        except MapError as error:
            text = str(error)
            assert text
            assert "\n" not in text


@RUNS
@given(
    st.lists(
        st.tuples(st.integers(0, len(SEED) - 1), st.integers(0, 20), st.binary(max_size=6)),
        min_size=1,
        max_size=4,
    )
)
def test_bytes_replaced(edits: list[tuple[int, int, bytes]]) -> None:
    data = SEED
    for at, cut, put in edits:
        data = data[:at] + put + data[at + cut :]
    must_answer(data)


def replaced(pattern: re.Pattern[bytes], data: bytes, pick: int, put: bytes, group: int = 0) -> bytes:
    found = list(pattern.finditer(data))
    if not found:
        return data
    match = found[pick % len(found)]
    return data[: match.start(group)] + put + data[match.end(group) :]


@RUNS
@given(st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from(VALUES)), min_size=1, max_size=5))
def test_numbers_replaced(edits: list[tuple[int, bytes]]) -> None:
    data = SEED
    for pick, value in edits:
        data = replaced(NUMBER, data, pick, value, 1)
    must_answer(data)


@RUNS
@given(st.lists(st.tuples(st.integers(0, 10**6), st.floats()), min_size=1, max_size=8))
def test_numbers_drawn(edits: list[tuple[int, float]]) -> None:
    data = SEED
    for pick, value in edits:
        data = replaced(NUMBER, data, pick, repr(value).encode(), 1)
    must_answer(data)


@RUNS
@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=4))
def test_attributes_removed(picks: list[int]) -> None:
    data = SEED
    for pick in picks:
        data = replaced(ATTRIBUTE, data, pick, b"")
    must_answer(data)


def subtree(data: bytes, pick: int) -> tuple[int, int]:
    """Start and end of one whole element other than the root."""
    found = [m for m in ELEMENT.finditer(data) if m[1] != b"OpenDRIVE"]
    match = found[pick % len(found)]
    if match[0].endswith(b"/>"):
        return match.start(), match.end()
    closing = re.compile(rb"</" + match[1] + rb">").search(data, match.end())
    return match.start(), closing.end() if closing else match.end()


@RUNS
@given(
    st.lists(
        st.tuples(st.sampled_from(["cut", "twice", "move"]), *[st.integers(0, 10**6)] * 2),
        min_size=1,
        max_size=3,
    )
)
def test_elements_cut_doubled_and_moved(edits: list[tuple[str, int, int]]) -> None:
    data = SEED
    for kind, pick, other in edits:
        a, b = subtree(data, pick)
        piece = data[a:b]
        if kind == "cut":
            data = data[:a] + data[b:]
        elif kind == "twice":
            data = data[:b] + piece + data[b:]
        else:
            at, _ = subtree(data, other)
            data = data[:at] + piece + data[at:]
    must_answer(data)
