"""Times of points in every convention: the time of the first point, those after it, and what is reported."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError, EvaluationError
from recorder.dataset.clouds import Cloud
from recorder.dataset.scans import Scan, ScanTimes, scans_of

BEGIN = 1_700_000_000_000_000_000
"""First point of the first sweep [ns]."""
SWEEP = 100_000_000
OFFSETS = np.arange(1000) * SWEEP // 1000
"""Times of the points after the first one [ns]."""
LATE = int(OFFSETS[-1])


def cloud(stamp_ns: int, times: dict[str, Any]) -> Cloud:
    return Cloud(
        stamp_ns=stamp_ns,
        points_xyz_m=np.ones((len(OFFSETS), 3)),
        times=times,
        ring=None,
        intensity=None,
        tag=None,
        fields=("x", "y", "z", *times),
    )


def scans(
    times: Callable[[int], dict[str, Any]],
    headers_ns: Sequence[int],
    said: ScanTimes = ScanTimes(),  # noqa: B008
) -> list[Scan]:
    """Scans of clouds, whose times are given for the first point of each."""

    def made() -> Iterator[tuple[int, Cloud]]:
        for k, header_ns in enumerate(headers_ns):
            yield BEGIN + (k + 1) * SWEEP, cloud(header_ns, times(BEGIN + k * SWEEP))

    return list(scans_of(made(), "bag: /topic", said))


def headers(after_begin_ns: int = 0, count: int = 12) -> list[int]:
    return [BEGIN + k * SWEEP + after_begin_ns for k in range(count)]


def after(zero_ns: int, unit_ns: int, code: str) -> Any:
    """Times of points from a zero on, in a unit, as a driver writes them."""
    exact = OFFSETS - zero_ns
    return (exact // unit_ns if code[1] in "iu" else exact / unit_ns).astype(code)


# Field, type, unit [ns]; the header's stamp after the first point [ns] where times are relative to it.
RELATIVE = [
    ("time", "<f4", 10**9, 0),
    ("time", "<f8", 10**9, 0),
    ("t", "<u4", 1, 0),
    ("offset_time", "<u4", 1, 0),
    ("time_offset", ">i4", 1, LATE),
    ("time", "<f4", 10**9, LATE),
    ("timestamp", "<f8", 10**9, LATE // 2),
    ("time", "<f4", 10**9, -SWEEP // 2),
]


@pytest.mark.parametrize(("field", "code", "unit_ns", "header_ns"), RELATIVE)
def test_relative_times(
    field: str, code: str, unit_ns: int, header_ns: int, caplog: pytest.LogCaptureFixture
) -> None:
    found = scans(lambda _: {field: after(header_ns, unit_ns, code)}, headers(header_ns))
    expect_sweeps(found)
    assert not caplog.messages


# Type, unit [ns].
ABSOLUTE = [("<f8", 10**9), ("<f8", 1), ("<u8", 1), ("<i8", 1000), ("<f8", 10**6), (">f8", 10**9)]


@pytest.mark.parametrize(("code", "unit_ns"), ABSOLUTE)
@pytest.mark.parametrize("header_ns", [0, LATE, 3 * SWEEP])
def test_absolute_times_of_the_same_clock(
    code: str, unit_ns: int, header_ns: int, caplog: pytest.LogCaptureFixture
) -> None:
    """Wherever the header's stamp lies: the points' own times count."""
    found = scans(lambda begin: {"timestamp": after(-begin, unit_ns, code)}, headers(header_ns))
    expect_sweeps(found)
    assert not caplog.messages


def test_times_of_another_clock_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    """A sensor that counts from its start: the header's stamp is taken for the first point's."""
    booted_ns = BEGIN - 57_250_000_000
    found = scans(lambda begin: {"t": (OFFSETS + (begin - booted_ns)) / 1e9}, headers())
    expect_sweeps(found)
    assert "another clock, -1699999942.750 s from" in caplog.messages[0]


@pytest.mark.parametrize(("unit", "unit_ns"), [("us", 1000), ("ms", 10**6)])
def test_an_unusual_unit_is_found_and_reported(
    unit: str, unit_ns: int, caplog: pytest.LogCaptureFixture
) -> None:
    expect_sweeps(scans(lambda _: {"time": after(0, unit_ns, "<f4")}, headers()))
    assert f"are read as {unit}; --time-unit sets another" in caplog.messages[0]


def test_the_unit_may_be_set_or_named(caplog: pytest.LogCaptureFixture) -> None:
    expect_sweeps(
        scans(lambda _: {"time": after(0, 1000, "<f4")}, headers(), ScanTimes(field="time", unit="us"))
    )
    expect_sweeps(scans(lambda _: {"time_us": after(0, 1000, "<u4")}, headers()))
    assert not caplog.messages
    with pytest.raises(ConfigError, match="no unit of time 'min'"):
        scans(lambda _: {"t": after(0, 1, "<u4")}, headers(), ScanTimes(unit="min"))


@pytest.mark.parametrize("times", [{}, {"time": np.zeros(1000, "<f4")}, {"timestamp": np.full(1000, np.nan)}])
def test_clouds_without_times_are_read_without_and_that_is_reported(
    times: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    found = scans(lambda _: times, headers())
    assert [scan.stamp_ns for scan in found] == headers()
    assert not any(scan.time_s.any() or len(scan.deskew_time_s) for scan in found)
    assert "points have no times" in caplog.messages[0]
    caplog.clear()
    scans(lambda _: times, headers(), ScanTimes(field="none"))
    assert not caplog.messages


def test_the_field_whose_times_differ_is_taken() -> None:
    expect_sweeps(scans(lambda _: {"time": np.zeros(1000), "t": after(0, 1, "<u4")}, headers()))


def test_headers_without_stamps_are_replaced_by_the_times_of_the_recording(
    caplog: pytest.LogCaptureFixture,
) -> None:
    found = scans(lambda _: {"time": after(0, 10**9, "<f4")}, [0] * 12)
    assert [scan.stamp_ns for scan in found] == headers(SWEEP)
    assert "headers have no stamps" in caplog.messages[0]


def test_a_sweep_that_begins_without_returns_still_begins_at_its_header() -> None:
    """First returns come a few columns late, never the same: what the header says is the beginning."""
    late = iter(np.arange(12) * 300_000)
    found = scans(lambda _: {"t": np.maximum(OFFSETS, next(late)).astype("<u4")}, headers())
    assert [scan.stamp_ns for scan in found] == headers()


def test_points_without_a_time_are_left_out() -> None:
    times = after(LATE, 10**9, "<f4")
    times[7] = np.nan
    found = scans(lambda _: {"time": times}, headers(LATE))
    assert [len(scan.time_s) for scan in found] == [999] * 12
    np.testing.assert_allclose([scan.stamp_ns for scan in found], headers(), atol=10)


def test_a_cloud_whose_times_go_astray_is_refused() -> None:
    astray = iter([0.0] * 11 + [1e300])
    with pytest.raises(EvaluationError, match="--time-field none"):
        scans(lambda begin: {"t": OFFSETS / 1e9 + begin / 1e9 + next(astray)}, headers())


def expect_sweeps(found: Sequence[Scan]) -> None:
    """Every scan begins with its first point, to a microsecond, and knows when the others were seen."""
    assert len(found) == 12
    for scan, begin_ns in zip(found, headers(), strict=True):
        assert scan.stamp_ns == pytest.approx(begin_ns, abs=1000)
        np.testing.assert_allclose(scan.time_s, OFFSETS * 1e-9, rtol=0, atol=1e-6)
