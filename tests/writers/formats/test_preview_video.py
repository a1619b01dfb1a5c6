"""The film of a sequence, read back."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.readings.bag_samples import cloud_of, write_all

from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import DepthImage, Image, PointCloud, SemanticImage
from recorder.dataset.layout import SequenceFolder
from recorder.replaying.recipe import Recipe
from recorder.replaying.sequence_writers import outputs_of
from recorder.report.mosaic import panel_of, panels_in
from recorder.writers.formats.preview_video import PreviewEncoder, PreviewWriter, shown_streams

COUNT, RATE_HZ = 25, 20.0
COLOUR = {"rgb_left": "rgb"}
PICTURES = ("rgb_left", "depth_left", "semantic_left", "rgb_right", "depth_right", "semantic_right")
CLOUDS = ("lidar", "lidar_semantic")
RIGS = {
    # Named rig, its streams that are pictures or clouds, those shown in their order, size of the film.
    "full": ("paper", (*PICTURES, *CLOUDS), (*PICTURES[:3], "lidar_semantic"), (720, 1280)),
    "no LiDAR": ("paper", PICTURES, PICTURES[:3], (360, 1920)),
    "no semantics": ("dsec", (*PICTURES[:2], *CLOUDS), (*PICTURES[:2], CLOUDS[1]), (360, 1920)),
    "stereo": ("paper", ("rgb_left", "rgb_right", "lidar"), ("rgb_left", "lidar"), (360, 1280)),
    "camera": ("minimal", ("rgb_front",), ("rgb_front",), (360, 640)),
    "LiDAR": ("lidar", CLOUDS, CLOUDS[1:], (360, 640)),
}  # fmt: skip


def _image(number: int) -> Image:
    """A grey ramp over which a bar moves."""
    rgb = np.repeat(np.linspace(40, 200, 640).astype(np.uint8)[None, :, None], 360, axis=0).repeat(3, axis=2)
    rgb[:, 20 * number : 20 * number + 40] = (200, 30, 30)
    return Image(
        sensor="rgb_left", frame_id="camera_left", stamp_ns=number * 50_000_000, rgb=np.ascontiguousarray(rgb)
    )


def _rgb(frame: av.VideoFrame) -> NDArray[np.uint8]:
    return np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)


def _still(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path)), np.uint8)[..., ::-1]


def test_film_is_h264_with_every_image(tmp_path: Path) -> None:
    images = [_image(number) for number in range(COUNT)]
    write_all(PreviewWriter(tmp_path / "preview.mp4", PreviewEncoder(COLOUR), rate_hz=RATE_HZ), images)
    with av.open(str(tmp_path / "preview.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        # Browsers play no other arrangement of pixels everywhere.
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == RATE_HZ
        frames = [_rgb(frame) for frame in container.decode(stream)]
    assert len(frames) == COUNT
    for frame, image in zip(frames, images, strict=True):
        assert cv2.PSNR(frame, panel_of(image)) > 30.0
    np.testing.assert_array_equal(_still(tmp_path / "preview.png"), panel_of(images[0]))


def test_no_film_without_a_picture(tmp_path: Path) -> None:
    with PreviewWriter(tmp_path / "preview.mp4", PreviewEncoder(COLOUR), rate_hz=RATE_HZ):
        pass
    assert list(tmp_path.iterdir()) == []


def _sample(stream: str, number: int) -> Image | DepthImage | SemanticImage | PointCloud:
    """A sample that differs from stream to stream and from instant to instant."""
    rng = np.random.default_rng([number, *stream.encode()])
    stamp_ns = number * 50_000_000
    coarse = rng.integers(1, 11, (9, 16)).repeat(40, axis=0).repeat(40, axis=1)
    if stream.startswith("rgb"):
        rgb = np.repeat(20 * coarse[..., None], 3, axis=2).astype(np.uint8)
        return Image(sensor=stream, frame_id=stream, stamp_ns=stamp_ns, rgb=rgb)
    if stream.startswith("depth"):
        depth_m = coarse.astype(np.float32) ** 2
        return DepthImage(sensor=stream, frame_id=stream, stamp_ns=stamp_ns, depth_m=depth_m)
    if stream.startswith("semantic"):
        tag, instance = coarse.astype(np.uint8), coarse.astype(np.uint32)
        return SemanticImage(
            sensor=stream, frame_id=stream, stamp_ns=stamp_ns, tag=tag, instance=instance
        )  # fmt: skip
    cloud = cloud_of(
        rng.uniform(-20.0, 20.0, (3000, 3)), stamp_ns, stream.endswith("_semantic"), intensity=1.0, tag=12,
        instance=1, cos_incidence=1.0,
    )  # fmt: skip
    return replace(cloud, sensor=stream, frame_id=stream)


@pytest.mark.parametrize("kind", RIGS)
def test_each_sensor_of_the_rig_has_a_panel_and_none_else(tmp_path: Path, kind: str) -> None:
    name, streams, shown, size = RIGS[kind]
    config = Recipe(
        episode=Path(), town=Path(), conditions=(), rig=rig_by_name(name), camera_ns=(0, 0), seed=0,
        quality="medium", formats=(), topics="slam", truth_tf=False, clock=False, preview=True,
    )  # fmt: skip
    (output,) = outputs_of(config, streams)
    assert isinstance(output.encoder, PreviewEncoder)
    # Without the caption, which would cover a part of the panels.
    writer = PreviewWriter(SequenceFolder(tmp_path / "data").film, output.encoder, rate_hz=RATE_HZ)
    instants = [{stream: _sample(stream, number) for stream in streams} for number in range(3)]
    write_all(writer, (sample for samples in instants for sample in samples.values()))
    with av.open(str(tmp_path / "data" / "preview.mp4")) as container:
        frames = [_rgb(frame) for frame in container.decode(video=0)]
    assert len(frames) == len(instants)
    for frame, samples in zip(frames, instants, strict=True):
        assert frame.shape == (*size, 3)
        panels = panels_in(frame)
        assert len(panels) == len(shown)
        for panel, stream in zip(panels, shown, strict=True):
            # Single bright points lose most in the film: half of their colour.
            assert cv2.PSNR(panel, panel_of(samples[stream])) > (18.0 if "lidar" in stream else 28.0)
    still = _still(tmp_path / "data" / "preview.png")
    for panel, stream in zip(panels_in(still), shown, strict=True):
        np.testing.assert_array_equal(panel, panel_of(instants[0][stream]))


def test_a_full_mosaic_is_a_square_of_its_panels(tmp_path: Path) -> None:
    """Colour and depth above, semantics and LiDAR below, as in all films of full rigs."""
    _, streams, _, _ = RIGS["full"]
    samples = {stream: _sample(stream, 0) for stream in streams}
    encoder = PreviewEncoder(shown_streams(streams, camera="left", lidar="lidar"))
    write_all(PreviewWriter(tmp_path / "a.mp4", encoder, rate_hz=RATE_HZ), samples.values())
    rgb, depth, semantic, cloud = (panel_of(samples[name]) for name in (*PICTURES[:3], CLOUDS[1]))
    still = _still(tmp_path / "a.png")
    np.testing.assert_array_equal(still[:360], np.concatenate([rgb, depth], axis=1))
    np.testing.assert_array_equal(still[360:], np.concatenate([semantic, cloud], axis=1))


def test_other_cameras_do_not_mix_in() -> None:
    """A camera may be named as the end of another's name."""
    streams = ("rgb_rear_left", "rgb_left", "depth_rear_left")
    assert shown_streams(streams, camera="left", lidar=None) == {"rgb_left": "rgb"}


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="needs FFmpeg's ffprobe")
def test_ffprobe_counts_the_same(tmp_path: Path) -> None:
    writer = PreviewWriter(tmp_path / "preview.mp4", PreviewEncoder(COLOUR), rate_hz=RATE_HZ)
    write_all(writer, map(_image, range(COUNT)))
    asked = "stream=codec_name,pix_fmt,nb_read_frames,r_frame_rate:format=duration"
    done = subprocess.run(
        ["ffprobe", "-v", "error", "-count_frames", "-show_entries", asked, "-of", "json",
         str(tmp_path / "preview.mp4")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr == ""
    told = json.loads(done.stdout)
    (stream,) = told["streams"]
    assert (stream["codec_name"], stream["pix_fmt"], stream["r_frame_rate"]) == ("h264", "yuv420p", "20/1")
    assert int(stream["nb_read_frames"]) == COUNT
    assert float(told["format"]["duration"]) == pytest.approx(COUNT / RATE_HZ)
