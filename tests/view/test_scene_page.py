"""Pages of drives in Chromium: what stands where and when, by mouse and by touch, at two widths, offline."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from shared_fixtures.processes.browser import SOLID, WIDTHS_PX, Browser
from shared_fixtures.readings.raw_gnss import in_a_street, write
from shared_fixtures.readings.slam_dataset import list_dataset, rig, write_dataset

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples.gnss_signals import BLOCKED, WAYS
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.cli.main import main
from recorder.dataset.sequence import SlamSequence
from recorder.episode.episode import Episode
from recorder.evaluation.trajectory_files import read_tum, write_tum
from recorder.replaying.options import ReplayConfig
from recorder.replaying.replay import replay
from recorder.view.scene_page import JPEG_QUALITY, PICTURE_WIDTH_PX, POINTS_MAX, TOWN_BYTES, ScenePage
from recorder.view.sequence_view import jpeg_of
from recorder.view.sky import read_sky
from recorder.writers.base import DEFAULT_EPOCH_NS

LOADED = """new Promise(done => { const note = document.getElementById('note');
const look = () => window.page ? done(note.textContent) : setTimeout(look, 50); look(); })"""
DRAG = """(() => { const view = document.getElementById('view'), before = page.camera.position.clone();
const send = (type, x, y) => view.dispatchEvent(new PointerEvent(type, { pointerId: 7, pointerType: '%s',
    clientX: x, clientY: y, button: 0, buttons: 1, bubbles: true }));
view.setPointerCapture = view.releasePointerCapture = () => {};
const strokes = [['down', 200], ['move', 240], ['move', 300], ['up', 300]];
for (const [type, x] of strokes) send('pointer' + type, x, x);
return page.camera.position.distanceTo(before); })()"""


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second in a room, with pictures that grow brighter."""
    root = write_dataset(tmp_path_factory.mktemp("set") / "set", sweeps=10)
    eyes = [
        CameraConfig(name=name, mount=Mount(position_m=(1.0, y, 1.5)))
        for name, y in {"left": 0.25, "right": -0.25}.items()
    ]
    list_dataset(root, SensorRig(name="box", sensors=(*rig().sensors, *eyes)))
    folder = root / "Box" / "ClearNoon_dynamic"
    images = folder / "mav0" / "cam0" / "data"
    images.mkdir(parents=True)
    for k in range(10):
        name = f"{DEFAULT_EPOCH_NS + k * 50_000_000}.png"
        cv2.imwrite(str(images / name), np.full((36, 64, 3), 20 * k, np.uint8))
    return folder


def test_a_sequence_is_shown_over_time(sequence: Path, tmp_path: Path) -> None:
    truth = read_tum(sequence.parent / "ground_truth" / "base_link.tum")
    lidar = sequence.parent / "ground_truth" / "lidar.tum"
    out = tmp_path / "scene.html"
    words = ["view", "--html", str(sequence), "--period", "0.1", "--estimate", str(lidar), "--out", str(out)]
    assert main(words) == 0
    text = out.read_text("utf-8")
    assert "http://" not in text.split("</style>")[0]
    assert 'src="http' not in text
    with Browser(tmp_path / "profile", SOLID) as browser:
        for width_px in WIDTHS_PX:
            browser.open(out.as_uri(), width_px)
            assert browser.run(LOADED) == ""
            assert browser.too_wide() == []
            assert "lidar, 0.000 m" in browser.run("document.getElementById('legend').innerText")
            end_s = float(browser.run("document.getElementById('slider').max"))
            assert end_s == pytest.approx((truth.stamp_ns[-1] - truth.stamp_ns[0]) / 1e9, abs=0.051)
            for second in (0.1, 0.33):
                at = truth.at(np.array([truth.stamp_ns[0] + round(second * 1e9)])).position_m[0]
                browser.run(f"page.show({second})")
                found = browser.run("page.place.toArray()")
                np.testing.assert_allclose(found, at - np.round(truth.position_m[0]), atol=2e-3)
            # Of a sweep every 0.1 s, three have begun.
            browser.run("document.getElementById('trail').selectedIndex = 3; page.show(0.25); page.render()")
            three = browser.run("page.drawn()")
            browser.run("page.show(0.05); page.render()")
            assert browser.run("page.drawn()") < three
            pixel = """new Promise(done => { const image = document.querySelector('#picture img');
                const read = () => { const sheet = document.createElement('canvas').getContext('2d');
                    sheet.drawImage(image, 0, 0, 8, 8); done(sheet.getImageData(4, 4, 1, 1).data[0]); };
                image.decode().then(read); })"""
            browser.run("page.show(0.31)")
            assert browser.run(pixel) == pytest.approx(20 * 6, abs=2)
            for pointer in ("mouse", "touch"):
                assert browser.run(DRAG % pointer) > 0.5
            play = "document.getElementById('play').click(); document.getElementById('play').textContent"
            assert browser.run(play) == "Pause"
        assert browser.errors == []


def test_the_sky_is_drawn_at_each_time(sequence: Path, tmp_path: Path) -> None:
    """Satellites of a street stand at their azimuths and elevations, and are counted by their ways."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    _, _, samples = in_a_street(1.0, rate_hz=2.0)
    root = shutil.copytree(sequence.parents[1], tmp_path / "set")
    folder = root / "Box" / sequence.name
    write(folder / "gnss", samples)
    out = tmp_path / "sky.html"
    assert main(["view", "--html", str(folder), "--out", str(out)]) == 0
    marks = """[...document.querySelectorAll('#sky g circle')].map(mark => [mark.nextSibling.textContent,
        Number(mark.getAttribute('cx')), Number(mark.getAttribute('cy')),
        mark.getAttribute('fill') == 'none'])"""
    with Browser(tmp_path / "profile", SOLID) as browser:
        for width_px in WIDTHS_PX:
            browser.open(out.as_uri(), width_px)
            assert browser.run(LOADED) == ""
            assert browser.too_wide() == []
            for second, raw in zip((0.2, 0.7), samples["gnss_raw"], strict=True):
                browser.run(f"page.show({second})")
                azimuth, away = np.radians(raw.sky_azimuth_deg), 90.0 - raw.sky_elevation_deg
                place = np.stack([away * np.sin(azimuth), -away * np.cos(azimuth)], axis=-1)
                drawn = browser.run(marks)
                assert [mark[0] for mark in drawn] == raw.sky_satellite.tolist()
                np.testing.assert_allclose([mark[1:3] for mark in drawn], place, atol=0.02)
                assert [mark[3] for mark in drawn] == (raw.sky_way == BLOCKED).tolist()
                lines = browser.run("document.getElementById('sky').innerText").split("\n")[-3:]
                assert [line.split(" ", 1) for line in lines] == [
                    [str(np.sum(raw.sky_way == way)), name] for way, name in enumerate(WAYS)
                ]
                assert len(set(raw.sky_way)) == 3
        assert browser.errors == []
    (folder / "gnss" / "gnss_signals.csv").write_text("stamp_ns,satellite\n1,G01\n")
    with pytest.raises(EvaluationError, match="is no table of signals; replay it anew"):
        read_sky(SlamSequence(folder))


@pytest.mark.long
def test_a_drive_is_followed_through_its_town(short_drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "drive.html"
    assert main(["view", "--html", str(short_drive), "--out", str(out)]) == 0
    ego = Episode.load(short_drive).ego
    with Browser(tmp_path / "profile", SOLID) as browser:
        for width_px in WIDTHS_PX:
            browser.open(out.as_uri(), width_px)
            assert browser.run(LOADED) == ""
            assert browser.too_wide() == []
            assert browser.run("page.render(); page.drawn()") > 1000
            away = "page.camera.position.distanceTo(page.place)"
            before = browser.run(away)
            browser.run("page.show(1e9)")
            last = ego["position_m"][(len(ego) - 1) // 10 * 10] - np.round(ego["position_m"][0])
            np.testing.assert_allclose(browser.run("page.place.toArray()"), last, atol=2e-3)
            assert browser.run(away) == pytest.approx(before, abs=1e-3)
        assert browser.errors == []


@pytest.mark.long
def test_a_sequence_shows_the_movers_of_its_drive(short_drive: Path, tmp_path: Path) -> None:
    """Boxes stand where the drive has its actors, and the page opens where an estimate leaves."""
    begin_s = 0.5
    config = ReplayConfig(
        episode=short_drive, out=tmp_path / "data", rig="state", start_s=begin_s, duration_s=1.0
    )
    (folder,) = replay(config).sequences
    truth = read_tum(folder.parent / "ground_truth" / "base_link.tum")
    late = truth.stamp_ns - truth.stamp_ns[0] > 600_000_000
    moved = replace(truth, position_m=truth.position_m + 3.0 * late[:, None] * [0.0, 0.0, 1.0])
    write_tum(tmp_path / "estimate.tum", moved)
    episode = Episode.load(short_drive)
    out = tmp_path / "scene.html"
    words = ["view", "--html", str(folder), "--drive", str(short_drive), "--frame", "base_link"]
    assert main([*words, "--estimate", str(tmp_path / "estimate.tum"), "--out", str(out)]) == 0
    with Browser(tmp_path / "profile", SOLID) as browser:
        browser.open(out.as_uri(), WIDTHS_PX[0])
        assert browser.run(LOADED) == ""
        assert 0.0 < float(browser.run("document.getElementById('slider').value")) <= 0.6
        browser.run("page.show(0.4)")
        frame = episode.timeline().actors_at(round(1e9 * (begin_s + 0.4)))
        browser.run("window.matrix = new THREE.Matrix4(); page.boxes.mesh.getMatrixAt(0, matrix)")
        found = np.array(browser.run("matrix.elements"))[12:15]
        height_m = episode.header.catalog.size_m[0, 2]
        wanted = frame.position_m[0] + [0.0, 0.0, 0.5 * height_m] - np.round(truth.position_m[0])
        np.testing.assert_allclose(found, wanted, atol=2e-2)
        assert browser.errors == []


@pytest.mark.long
def test_half_a_minute_fits_in_an_attachment(tmp_path: Path) -> None:
    """Noise, which packs worst, in place of sweeps and pictures, and the most that a town may take."""
    rng = np.random.default_rng(1)
    page = ScenePage("noise", np.zeros(3))
    page._part(rng.integers(0, 256, TOWN_BYTES), "u1")
    clouds = (
        (k * 200_000_000, rng.uniform(-80, 80, (66_000, 3)), rng.integers(0, 29, 66_000).astype(np.uint8))
        for k in range(150)
    )
    page.add_clouds(clouds, np.zeros((256, 3), np.uint8), 0.2)
    assert page._meta["clouds"]["position"]["count"] <= 150 * 3 * POINTS_MAX
    street = cv2.resize(rng.integers(0, 256, (90, 160, 3)).astype(np.uint8), (1280, 720))
    jpeg = jpeg_of(street, PICTURE_WIDTH_PX, JPEG_QUALITY)
    page.add_pictures((k * 200_000_000, jpeg + bytes(rng.integers(0, 256, 64))) for k in range(150))
    assert page.write(tmp_path / "noise.html").stat().st_size <= 25e6
