"""The page of a benchmark: self-contained, with a figure for every sequence, numbers that can be checked."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.figures import (
    Box,
    Line,
    box_figure,
    curve_figure,
    map_figure,
    real_time_figure,
    thinned,
)
from recorder.benchmark.page import write_page
from recorder.benchmark.run import BenchmarkConfig, run_benchmark


def test_the_page_needs_nothing_but_itself(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp", reason="the benchmark runs small_gicp")
    data = write_dataset(tmp_path / "set", sweeps=15)
    config = BenchmarkConfig(data=data, out=tmp_path / "out", methods=("small_gicp",))
    text = write_page(run_benchmark(config), tmp_path / "out").read_text()
    assert not re.findall(r"(?:src|href)=[\"'](?!data:)", text)
    assert text.count('class="curve"') == 2  # over time and over the way
    assert "small_gicp seg" in text
    for svg in re.findall(r"<svg.*?</svg>", text, re.S):
        ET.fromstring(svg)


def test_a_map_keeps_the_shape_of_a_path() -> None:
    truth = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]])
    line = Line(label="a & b", colour="#000000", x=truth[:, 0], y=truth[:, 1])
    figure = ET.fromstring(map_figure(truth, [line], []))
    drawn = next(e for e in figure.iter("polyline") if e.get("class") == "line")
    points = np.array([p.split(",") for p in str(drawn.get("points")).split()], float)
    east, north = points[1] - points[0], points[2] - points[1]
    assert east[1] == pytest.approx(0.0, abs=0.2)
    assert north[0] == pytest.approx(0.0, abs=0.2)
    assert east[0] == pytest.approx(-2.0 * north[1], rel=0.01)  # pixels count downwards


def test_long_curves_keep_their_peaks() -> None:
    x = np.arange(50_000.0)
    y = np.zeros(50_000)
    y[31_234] = 7.0
    short_x, short_y = thinned(x, y)
    assert len(short_x) == 600
    assert short_x[np.argmax(short_y)] == 31_234
    figure = ET.fromstring(
        curve_figure([Line(label="l", colour="#111111", x=x, y=y)], "time [s]", "error [m]", name="s0")
    )
    told = [e.text for e in figure.iter("title")]
    assert "l: 7.000 m at 31234.0 s" in told


def test_boxes_show_failures() -> None:
    values = np.linspace(0.0, 1.0, 101)
    boxes = [
        Box(label="good", colour="#111111", values=values, runs=3),
        Box(label="at times", colour="#222222", values=values, failed=1, runs=3),
        Box(label="never", colour="#333333", values=np.zeros(0), failed=3, runs=3),
    ]
    figure = ET.fromstring(box_figure(boxes, "APE [m]"))
    assert [e.text for e in figure.iter("text") if e.get("class") == "failed"] == ["✕ 1 of 3 fail", "✕ fail"]
    rows = [float(str(e.get("y"))) + 7 for e in figure.iter("rect")]
    assert rows == [14.0, 36.0]  # no box where there is nothing to sum up
    median = next(e for e in figure.iter("line") if e.get("class") == "median")
    left, scale = 120.0, (275 - 12) / 1.05
    # Whiskers end at the 95th percentile, and the axis 5 % beyond the longest.
    assert float(str(median.get("x1"))) == pytest.approx(left + 0.5 * scale / 0.95, abs=0.1)


def test_bars_of_run_time_are_logarithmic() -> None:
    ratios = (0.1, 1.0, 10.0)
    figure = ET.fromstring(real_time_figure([(f"s{k}", "#111111", r) for k, r in enumerate(ratios)]))
    widths = [float(str(e.get("width"))) for e in figure.iter("rect")]
    line = next(e for e in figure.iter("line") if e.get("class") == "cursor")
    assert widths[1] == pytest.approx(0.5 * widths[2], abs=0.1)
    assert float(str(line.get("x1"))) == pytest.approx(120 + widths[1], abs=0.1)
