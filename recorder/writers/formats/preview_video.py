"""A short film of a sequence: colour, depth, semantics and LiDAR side by side."""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from av.container import OutputContainer

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Image, PointCloud, Sample, SemanticImage
from recorder.report.mosaic import joined, panel_of
from recorder.writers.base import Piece, Writer

_STILL_EVERY = 60
_PANEL_OF = {Image: "rgb", DepthImage: "depth", SemanticImage: "semantic"}
_PANEL_SHAPE = (360, 640, 3)
"""Shape of a panel of a film 1280 pixels wide."""
_X264 = {"crf": "23", "preset": "veryfast", "threads": "1"}
"""Quality and effort of the encoder; one thread, since every level has a process of its own."""


class PreviewWriter(Writer):
    """An mp4 with one image per instant of the first camera; nothing without a camera.

    The film is `target`; one of its images stands beside it as `<stem>.png`.
    """

    def __init__(self, target: str | Path, *, camera: str, rate_hz: float, caption: str = "") -> None:
        super().__init__(target)
        # The container is chosen by the file's ending.
        self._part = self.target.with_name(f".part-{self.target.name}")
        self._camera = camera
        self._rate_hz = rate_hz
        self._caption = caption
        self._film: _Film | None = None
        self._shown: dict[str, U8] = {}
        self._cloud: U8 | None = None
        self._still: U8 | None = None
        self._count = 0

    def _begin(self, part: Path) -> None:
        self._film = None

    def encode(self, sample: Sample) -> list[Piece]:
        """The sample's panel of the film."""
        if isinstance(sample, PointCloud):
            kind = "plain" if sample.tag is None else "labelled"
            return [Piece(sample.stamp_ns, "cloud", kind, panel_of(sample).tobytes())]
        if isinstance(sample, (Image, DepthImage, SemanticImage)) and sample.sensor.endswith(
            f"_{self._camera}"
        ):
            return [Piece(sample.stamp_ns, _PANEL_OF[type(sample)], "", panel_of(sample).tobytes())]
        return []

    def _place(self, piece: Piece) -> None:
        panel = np.frombuffer(piece.data, np.uint8).reshape(_PANEL_SHAPE)
        if piece.place == "cloud":
            if piece.kind == "labelled" or self._cloud is None:
                self._cloud = panel
            return
        if piece.place == "rgb":
            self._show()
            self._shown.clear()
        self._shown[piece.place] = panel

    def _show(self) -> None:
        if "rgb" not in self._shown:
            return
        panels = self._shown if self._cloud is None else {**self._shown, "cloud": self._cloud}
        image = joined(panels, caption=self._caption)
        if self._film is None:
            self._film = _Film(self._part, image.shape[1], image.shape[0], self._rate_hz)
        self._film.add(image)
        if self._count % _STILL_EVERY == 0:
            self._still = image
        self._count += 1

    def _finish(self) -> None:
        self._show()
        if self._film is None:
            # A rig without a camera leaves no film, and no error.
            self._part.write_bytes(b"")
        else:
            self._film.complete()

    def close(self) -> None:
        """Complete the film; without a single image there is none."""
        super().close()
        if self._still is None:
            self.target.unlink(missing_ok=True)
            return
        path = self.target.with_suffix(".png")
        done, png = cv2.imencode(".png", cv2.cvtColor(self._still, cv2.COLOR_RGB2BGR))
        assert done
        try:
            path.write_bytes(png.tobytes())
        except OSError as error:
            path.unlink(missing_ok=True)
            self.target.unlink(missing_ok=True)
            raise WriterError(f"cannot write {path}: {error.strerror}") from error

    def _drop(self) -> None:
        if self._film is not None:
            with suppress(OSError):
                self._film.complete()


class _Film:
    """H.264 in an mp4, which browsers play."""

    def __init__(self, path: Path, width_px: int, height_px: int, rate_hz: float) -> None:
        rate = Fraction(rate_hz).limit_denominator(1000)
        container = av.open(str(path), "w", format="mp4")
        self._container: OutputContainer | None = container
        self._stream = container.add_stream("libx264", rate=rate, options=_X264)
        self._stream.width, self._stream.height = width_px, height_px
        self._stream.pix_fmt = "yuv420p"

    def add(self, rgb: U8) -> None:
        """Add an image, shape (H, W, 3)."""
        assert self._container is not None
        frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def complete(self) -> None:
        """Write what is still held back, and close the file."""
        if self._container is not None:
            container, self._container = self._container, None
            try:
                container.mux(self._stream.encode(None))
            finally:
                container.close()
