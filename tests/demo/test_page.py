"""The demo's page in Chromium, as it grows step by step."""

from pathlib import Path

import av
import cv2
import numpy as np
from shared_fixtures.processes.browser import WIDTHS_PX, Browser

from recorder.demo.answers import CONDITIONS, Answer, meaning_of
from recorder.demo.page import EXTRAS, write_index
from recorder.demo.story import LOOK, TRAFFIC


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


def answer(title: str, weather: str, **ape_m: float) -> Answer:
    """An answer by errors of conditions, without paths."""
    named = dict(zip(CONDITIONS, ape_m.values(), strict=False))
    return Answer(
        title=title,
        weather=weather,
        ape_m=named,
        errors={},
        range_m={name: (0.5 * value, 2.0 * value) for name, value in named.items()},
        meaning=meaning_of(named, {}),
    )


def test_the_page_grows_and_fits_a_phone(tmp_path: Path) -> None:
    """Pictures and films of each step are there, the answer first, and the command for the rest."""
    cv2.imwrite(str(tmp_path / LOOK), np.full((1080, 1920, 3), 99, np.uint8))
    cv2.imwrite(str(tmp_path / "story.png"), np.full((900, 1600, 3), 99, np.uint8))
    films = [write_film(tmp_path / "data" / f"ClearNoon_{level}" / "preview.mp4") for level in TRAFFIC]
    answers = [
        answer("stereo", "ClearNoon", static=0.1234, dynamic=1.5, masked=0.0987),
        answer("GICP", "ClearNoon", static=0.0321, dynamic=0.0322, masked=0.0321),
    ]
    drawn = [tmp_path / "story.png", tmp_path / "report.html"]
    with Browser(tmp_path / "profile") as browser:
        for width_px in WIDTHS_PX:
            for step, parts in ((2, ([], (), [])), (3, (films, (), [])), (4, (films, answers, drawn))):
                browser.open(write_index(tmp_path, *parts, step=step).as_uri(), width_px)
                assert browser.too_wide() == []
                widths = browser.run("[...document.images].map(image => image.naturalWidth)")
                assert widths == ([1920] if step < 4 else [1600, 1920])
                assert browser.run("document.querySelectorAll('video').length") == (0 if step == 2 else 2)
                text = browser.run("document.body.innerText")
                assert (f"Step {step} of 3" in text) == (step < 4)
            for part in ("is 0.12 m where nothing moves, 1.50 m among", "0.123 m", "(0.06–0.25)", "by 12.2"):
                assert part in text
            assert "does not mislead" in text
            assert EXTRAS not in text
        scene = tmp_path / "scene.html"
        browser.open(write_index(tmp_path, films, answers, [], step=4, scene=scene).as_uri(), 390)
        assert "scene.html" in browser.run("[...document.links].map(link => link.getAttribute('href'))")
        assert EXTRAS in browser.run("document.body.innerText")
        assert browser.errors == []
