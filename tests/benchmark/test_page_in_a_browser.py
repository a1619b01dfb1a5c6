"""The report in Chromium: a click on a peak of the error shows the frame of that time."""

import base64
import re
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from shared_fixtures.processes.browser import WIDTHS_PX, Browser
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.page import write_page
from recorder.benchmark.run import BenchmarkConfig, run_benchmark

FRAMES, FRAMES_PER_S = 15, 10
CLICK = """(() => {
const peak = document.querySelectorAll('svg.curve')[%d].querySelector('g.peak');
const at = peak.getBoundingClientRect(), x = at.x + at.width / 2, y = at.y + at.height / 2;
peak.dispatchEvent(new MouseEvent('click', {bubbles: true, clientX: x, clientY: y}));
})()"""
PEAK = 7
"""Number of the sweep at which the system errs."""
SYSTEM = f"""
import numpy as np
from carlaloc_env.core.transforms import transform
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.system import System

SYSTEM = System(name="jumps", title="jumps", what="truth but for a jump", needs=("lidar",), runner="x:run",
                frame="lidar")


def run(sequence, clock):
    truth = read_tum(sequence.truth_file("lidar"))
    poses = []
    for k, scan in enumerate(sequence.scans()):
        with clock.frame():
            at = truth.at(np.array([scan.stamp_ns]))
            T = transform(at.position_m[0], at.quat_xyzw[0])
            T[2, 3] += 0.5 * (k == {PEAK})
        poses.append((scan.stamp_ns, T))
    return poses
"""


def write_film(path: Path) -> None:
    """A film whose frames are each of one grey, brighter and brighter."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=Fraction(FRAMES_PER_S))
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        for k in range(FRAMES):
            picture = np.full((360, 640, 3), 20 + 15 * k, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode())


def shown_after(browser: Browser, curve: int) -> tuple[float, float]:
    """Time in the caption [s], and the number of the frame, once a curve's first peak was clicked on."""
    browser.run(CLICK % curve)
    told = re.fullmatch(r"t = ([\d.]+) s, .*", browser.run("document.getElementById('cap-s0').textContent"))
    assert told is not None
    image = str(browser.run("document.getElementById('img-s0').src")).removeprefix("data:image/jpeg;base64,")
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(image), np.uint8), cv2.IMREAD_GRAYSCALE)
    return float(told[1]), (float(np.mean(np.asarray(picture))) - 20) / 15


def test_a_click_on_a_peak_shows_its_frame(tmp_path: Path) -> None:
    """On a desk's screen and a phone's, where nothing is wider than the screen or writes an error."""
    with Browser(tmp_path / "profile") as browser:
        data = write_dataset(tmp_path / "set", sweeps=FRAMES)
        write_film(data / "Box" / "ClearNoon_dynamic" / "preview.mp4")
        (tmp_path / "jumps.py").write_text(SYSTEM)
        method = str(tmp_path / "jumps.py")
        config = BenchmarkConfig(data=data, out=tmp_path / "out", methods=(method,), clouds=("raw",))
        page = write_page(run_benchmark(config))
        for width_px in WIDTHS_PX:
            browser.open(page.as_uri(), width_px)
            assert browser.too_wide() == []
            for curve in (0, 1):  # over time, and over the way
                time_s, frame = shown_after(browser, curve)
                assert time_s == pytest.approx(PEAK / FRAMES_PER_S, abs=0.051)
                assert frame == pytest.approx(PEAK, abs=0.6)
        assert browser.errors == []
