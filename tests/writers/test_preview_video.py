"""The film of a sequence, read back."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from carlaloc_env.samples import Image
from recorder.report.mosaic import mosaic
from recorder.writers.formats.preview_video import PreviewWriter

COUNT, RATE_HZ = 25, 20.0


def _image(number: int) -> Image:
    """A grey ramp over which a bar moves."""
    rgb = np.repeat(np.linspace(40, 200, 640).astype(np.uint8)[None, :, None], 360, axis=0).repeat(3, axis=2)
    rgb[:, 20 * number : 20 * number + 40] = (200, 30, 30)
    return Image(
        sensor="rgb_left", frame_id="camera_left", stamp_ns=number * 50_000_000, rgb=np.ascontiguousarray(rgb)
    )


def test_film_is_h264_with_every_image(tmp_path: Path) -> None:
    images = [_image(number) for number in range(COUNT)]
    with PreviewWriter(tmp_path / "preview.mp4", camera="left", rate_hz=RATE_HZ) as writer:
        for image in images:
            writer.write(image)
    with av.open(str(tmp_path / "preview.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        # Browsers play no other arrangement of pixels everywhere.
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == RATE_HZ
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == COUNT
    for frame, image in zip(frames, images, strict=True):
        assert cv2.PSNR(frame, mosaic(image, None, None, None)) > 30.0
    still = cv2.imread(str(tmp_path / "preview.png"))
    assert still is not None
    np.testing.assert_array_equal(still[..., ::-1], mosaic(images[0], None, None, None))


def test_no_film_without_a_camera(tmp_path: Path) -> None:
    with PreviewWriter(tmp_path / "preview.mp4", camera="left", rate_hz=RATE_HZ):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="needs FFmpeg's ffprobe")
def test_ffprobe_counts_the_same(tmp_path: Path) -> None:
    with PreviewWriter(tmp_path / "preview.mp4", camera="left", rate_hz=RATE_HZ) as writer:
        for number in range(COUNT):
            writer.write(_image(number))
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
