"""The page of a benchmark: self-contained, with a figure for every sequence, numbers that can be checked."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.page import write_page
from recorder.benchmark.plots import (
    Box,
    Line,
    box_plot,
    curve_plot,
    map_plot,
    real_time_plot,
)
from recorder.benchmark.run import BenchmarkConfig, run_benchmark

SVG = "{http://www.w3.org/2000/svg}"


def test_the_page_needs_nothing_but_itself(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp", reason="the benchmark runs small_gicp")
    data = write_dataset(tmp_path / "set", sweeps=15)
    config = BenchmarkConfig(data=data, out=tmp_path / "out", methods=("small_gicp",))
    text = write_page(run_benchmark(config)).read_text()
    assert not re.findall(r"(?:src|href)=[\"'](?!data:|#)", text)
    assert text.count('class="curve"') == 2  # over time and over the way
    assert "small_gicp seg" in text
    lead, table = text.index("Position errors: small_gicp 0."), text.index("<table")
    assert lead < text.index("<svg") < table
    for svg in re.findall(r"<svg.*?</svg>", text, re.S):
        ET.fromstring(svg)


def points_of(path: str) -> np.ndarray:
    """Corners of a path, shape (N, 2), in units of the figure, which count downwards."""
    return np.array(re.findall(r"[ML] (\S+) (\S+)", path), float).reshape(-1, 2)


def drawn(figure: str, title: str) -> np.ndarray:
    """Corners of the line of a name."""
    for group in ET.fromstring(figure).iter(f"{SVG}g"):
        if group.findtext(f"{SVG}title") == title:
            return points_of(next(group.iter(f"{SVG}path")).get("d", ""))
    raise AssertionError(f"no {title}")


def filled(figure: str, colour: str) -> np.ndarray:
    """Corners of the area of a colour."""
    (path,) = [e for e in ET.fromstring(figure).iter(f"{SVG}path") if f"fill: {colour}" in e.get("style", "")]
    return points_of(path.get("d", ""))


def test_a_map_keeps_the_shape_of_a_path() -> None:
    truth = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]])
    line = Line(label='a & "b"', colour="#000000", x=truth[:, 0], y=truth[:, 1])
    points = drawn(map_plot(truth, [line], []), 'a & "b"')
    east, north = points[1] - points[0], points[2] - points[1]
    assert east[1] == pytest.approx(0.0, abs=0.01)
    assert north[0] == pytest.approx(0.0, abs=0.01)
    assert east[0] == pytest.approx(-2.0 * north[1], rel=1e-4)


def test_long_curves_keep_their_peaks_and_say_where_zero_is() -> None:
    x, y = np.arange(50_000.0), np.zeros(50_000)
    y[31_234] = 7.0
    line = Line(label="l", colour="#111111", x=x, y=y)
    figure = curve_plot([line], "time [s]", "error [m]", name="s0")
    assert "l: 7.000 m at 31234.0 s" in [title.text for title in ET.fromstring(figure).iter(f"{SVG}title")]
    points = drawn(figure, "l")
    assert len(points) < 100
    top = points[np.argmin(points[:, 1])]
    root = ET.fromstring(figure)
    width = float(str(root.get("viewBox")).split()[2])
    left, inner, x_max = (float(str(root.get(f"data-{name}"))) for name in ("left", "width", "xmax"))
    assert (top[0] / width - left) / inner * x_max == pytest.approx(31_234, abs=x_max / 1000)


def test_curves_without_a_gallery_are_areas_from_zero() -> None:
    """An error ten times as large is ten times as high."""
    x, errors_m = np.arange(3.0), {"none": 0.0, "static": 0.14, "dynamic": 1.4}
    lines = [Line(label=name, colour="#111111", x=x, y=np.full(3, y)) for name, y in errors_m.items()]
    figure = curve_plot(lines, "time [s]", "error [m]")
    none, static, dynamic = (drawn(figure, name)[0, 1] for name in errors_m)
    assert none - dynamic == pytest.approx(10 * (none - static), rel=1e-3)
    assert figure.count("fill: #111111; fill-opacity: 0.2") == 3


def test_boxes_show_failures() -> None:
    values = np.linspace(0.0, 1.0, 101)
    boxes = [
        Box(label="good", colour="#111111", values=values, runs=3),
        Box(label="at times", colour="#222222", values=values, failed=1, runs=3),
        Box(label="never", colour="#333333", values=np.zeros(0), failed=3, runs=3),
    ]
    figure = box_plot(boxes, "APE [m]")
    assert re.findall("✕ [^<]*", figure) == ["✕ 1 of 3 fail", "✕ fail"]
    assert len(filled(figure, "#333333")) == 0  # no box where there is nothing to sum up
    first, second = filled(figure, "#111111"), filled(figure, "#222222")
    assert first[:, 0].tolist() == second[:, 0].tolist()
    assert second[0, 1] > first[0, 1]
    # Lines up and down are the whiskers' caps and medians of both boxes.
    upright = [points_of(path)[:, 0] for path in re.findall(r'd="(M \S+ \S+ \nL \S+ \S+ \n)"', figure)]
    at = sorted({float(x[0]) for x in upright if x[0] == x[1]})
    low, high = first[:, 0].min(), first[:, 0].max()
    zero = low - 0.5 * (high - low)
    for share in (0.05, 0.5, 0.95):
        assert min(abs(x - (zero + 2 * share * (high - low))) for x in at) < 0.01


def test_bars_of_run_time_are_logarithmic() -> None:
    bars = [(f"s{k}", f"#11111{k}", ratio) for k, ratio in enumerate((0.1, 1.0, 10.0))]
    figure = real_time_plot(bars)
    ends = [filled(figure, colour)[:, 0].max() for _, colour, _ in bars]
    assert ends[2] - ends[1] == pytest.approx(ends[1] - ends[0], abs=0.01)
    assert ends[1] > ends[0] + 50
