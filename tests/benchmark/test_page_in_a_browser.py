"""The report in Chromium: a click on a peak of the error shows the frame of that time."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.page import write_page
from recorder.benchmark.run import BenchmarkConfig, run_benchmark

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FRAMES, FRAMES_PER_S = 15, 10
CLICK = """
<script>
const peak = document.querySelectorAll('svg.curve')[%d].querySelector('g.peak');
const at = peak.getBoundingClientRect(), x = at.x + at.width / 2, y = at.y + at.height / 2;
peak.dispatchEvent(new MouseEvent('click', {bubbles: true, clientX: x, clientY: y}));
</script>
"""
PEAK = 7
"""Number of the sweep at which the system errs."""
SYSTEM = f"""
import numpy as np
from carlaloc_env.core.geometry.transforms import transform
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


def shown_after(page: Path, curve: int) -> tuple[float, float]:
    """Time in the caption [s], and the number of the frame, once a curve's first peak was clicked on."""
    clicked = page.with_name(f"clicked_{curve}.html")
    clicked.write_text(page.read_text() + CLICK % curve)
    words = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--window-size=1280,900"]
    words += [f"--user-data-dir={page.parent / 'profile'}", "--dump-dom", clicked.as_uri()]
    dom = subprocess.run(words, capture_output=True, text=True, timeout=600, check=True).stdout
    told = re.search(r'id="cap-s0">t = ([\d.]+) s', dom)
    image = re.search(r'<img id="img-s0"[^>]*src="data:image/jpeg;base64,([^"]+)"', dom)
    assert told is not None
    assert image is not None
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(image[1]), np.uint8), cv2.IMREAD_GRAYSCALE)
    return float(told[1]), (float(np.mean(np.asarray(picture))) - 20) / 15


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_click_on_a_peak_shows_its_frame(tmp_path: Path) -> None:
    data = write_dataset(tmp_path / "set", sweeps=FRAMES)
    write_film(data / "Box" / "ClearNoon_dynamic" / "preview.mp4")
    (tmp_path / "jumps.py").write_text(SYSTEM)
    method = str(tmp_path / "jumps.py")
    config = BenchmarkConfig(data=data, out=tmp_path / "out", methods=(method,), clouds=("raw",))
    page = write_page(run_benchmark(config))
    for curve in (0, 1):  # over time, and over the way
        time_s, frame = shown_after(page, curve)
        assert time_s == pytest.approx(PEAK / FRAMES_PER_S, abs=0.051)
        assert frame == pytest.approx(PEAK, abs=0.6)
