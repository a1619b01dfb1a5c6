"""The demo's page in Chromium, as it grows step by step."""

from pathlib import Path

import av
import cv2
import numpy as np
from shared_fixtures.processes.browser import WIDTHS_PX, Browser

from recorder.benchmark.score import Score
from recorder.demo.page import EXTRAS, write_index
from recorder.demo.story import LOOK, TRAFFIC, Scores
from recorder.evaluation.path_errors import PathErrors


def write_film(path: Path) -> Path:
    """Three grey frames."""
    path.parent.mkdir(parents=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        for _ in range(3):
            frame = av.VideoFrame.from_ndarray(np.full((360, 640, 3), 99, np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def scores_of(**ape_m: tuple[float, float]) -> Scores:
    """Scores of systems: their errors static and dynamic [m]."""
    stamp_ns = np.arange(3)
    path_m = np.zeros((3, 3))
    errors = PathErrors(name="e", stamp_ns=stamp_ns, truth_m=path_m, estimate_m=path_m, error_m=np.zeros(3))
    return {
        system: {
            level: (
                Score(
                    dataset="data", town="Town10", weather="ClearNoon", traffic=level, cloud="raw",
                    method=system, title=system, run=1, version="1", failed=None, ape_m=value,
                ),
                errors,
            )
            for level, value in zip(TRAFFIC, values, strict=True)
        }
        for system, values in ape_m.items()
    }  # fmt: skip


def test_the_page_grows_and_fits_a_phone(tmp_path: Path) -> None:
    """Pictures and films of each step are there, errors to the millimetre, and the command for the rest."""
    cv2.imwrite(str(tmp_path / LOOK), np.full((1080, 1920, 3), 99, np.uint8))
    cv2.imwrite(str(tmp_path / "story.png"), np.full((900, 1600, 3), 99, np.uint8))
    films = [write_film(tmp_path / "data" / f"ClearNoon_{level}" / "preview.mp4") for level in TRAFFIC]
    scores = scores_of(GICP=(0.1234, 0.5), stereo=(0.0321, 12.5))
    drawn = [tmp_path / "story.png", tmp_path / "report.html"]
    with Browser(tmp_path / "profile") as browser:
        for width_px in WIDTHS_PX:
            for step, parts in ((2, ([], {}, [])), (3, (films, {}, [])), (4, (films, scores, drawn))):
                browser.open(write_index(tmp_path, *parts, step=step).as_uri(), width_px)
                assert browser.too_wide() == []
                widths = browser.run("[...document.images].map(image => image.naturalWidth)")
                assert widths == ([1920] if step < 4 else [1920, 1600])
                assert browser.run("document.querySelectorAll('video').length") == (0 if step == 2 else 2)
                text = browser.run("document.body.innerText")
                assert (f"Step {step} of 3" in text) == (step < 4)
            assert "0.123 m" in text
            assert "12.500 m" in text
            assert EXTRAS not in text
        scene = tmp_path / "scene.html"
        browser.open(write_index(tmp_path, films, scores, [], step=4, scene=scene).as_uri(), 390)
        assert "scene.html" in browser.run("[...document.links].map(link => link.getAttribute('href'))")
        assert EXTRAS in browser.run("document.body.innerText")
        assert browser.errors == []
