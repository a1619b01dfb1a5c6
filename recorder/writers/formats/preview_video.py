"""A short film of a sequence: colour, depth, semantics and LiDAR side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Image, PointCloud, Sample, SemanticImage
from recorder.report.mosaic import mosaic
from recorder.writers.base import Writer

_STILL_EVERY = 60


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
        self._film: cv2.VideoWriter | None = None
        self._shown: dict[str, Sample] = {}
        self._cloud: PointCloud | None = None
        self._still: NDArray[Any] | None = None
        self._count = 0

    def _begin(self, part: Path) -> None:
        self._film = None

    def _put(self, sample: Sample) -> None:
        if isinstance(sample, PointCloud) and (sample.tag is not None or self._cloud is None):
            self._cloud = sample
        elif isinstance(sample, (Image, DepthImage, SemanticImage)) and sample.sensor.endswith(
            f"_{self._camera}"
        ):
            if isinstance(sample, Image):
                self._show()
                self._shown.clear()
            self._shown[type(sample).__name__] = sample

    def _show(self) -> None:
        rgb = self._shown.get("Image")
        depth, semantic = self._shown.get("DepthImage"), self._shown.get("SemanticImage")
        if not isinstance(rgb, Image):
            return
        image = mosaic(
            rgb,
            depth if isinstance(depth, DepthImage) else None,
            semantic if isinstance(semantic, SemanticImage) else None,
            self._cloud,
            caption=self._caption,
        )
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        if self._film is None:
            size = (bgr.shape[1], bgr.shape[0])
            code = cv2.VideoWriter.fourcc(*"mp4v")
            self._film = cv2.VideoWriter(str(self._part), code, self._rate_hz, size)
            if not self._film.isOpened():
                raise WriterError(f"cannot write {self.target}: OpenCV has no mp4 encoder here")
        self._film.write(bgr)
        if self._count % _STILL_EVERY == 0:
            self._still = bgr
        self._count += 1

    def _finish(self) -> None:
        self._show()
        if self._film is None:
            # A rig without a camera leaves no film, and no error.
            self._part.write_bytes(b"")
        else:
            self._film.release()

    def close(self) -> None:
        """Complete the film; without a single image there is none."""
        super().close()
        if self._still is None:
            self.target.unlink(missing_ok=True)
        else:
            cv2.imwrite(str(self.target.with_suffix(".png")), self._still)

    def _drop(self) -> None:
        if self._film is not None:
            self._film.release()
