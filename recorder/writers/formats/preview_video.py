"""A short film of a sequence: colour, depth, semantics and LiDAR of its rig, side by side."""

from collections.abc import Collection, Mapping
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Image, PointCloud, Sample, SemanticImage
from recorder.report.mosaic import PANEL_HEIGHT_PX, PANEL_WIDTH_PX, joined, panel_of
from recorder.writers.base import Encoder, Piece, Writer, png_of

if TYPE_CHECKING:
    from av.container import OutputContainer

_STILL_EVERY = 60
_PANEL_SHAPE = (PANEL_HEIGHT_PX, PANEL_WIDTH_PX, 3)
_X264 = {"crf": "23", "preset": "veryfast", "threads": "1"}
"""Quality and effort of the encoder; one thread, since every level runs in a separate process."""


def shown_streams(streams: Collection[str], *, camera: str | None, lidar: str | None) -> dict[str, str]:
    """Streams that a film shows and the panel of each, in the order of `mosaic.PANELS`.

    Args:
        streams: Names of all streams of the rig.
        camera: Name of the camera that is shown, if there is one.
        lidar: Name of the LiDAR that is shown, if there is one; its labelled cloud, where the rig has it.
    """
    of_camera = {f"{panel}_{camera}": panel for panel in ("rgb", "depth", "semantic")} if camera else {}
    clouds = [name for name in (f"{lidar}_semantic", f"{lidar}") if lidar and name in streams]
    shown = {name: panel for name, panel in of_camera.items() if name in streams}
    return {**shown, **dict.fromkeys(clouds[:1], "cloud")}


class PreviewEncoder(Encoder):
    """Panels of a film.

    Args:
        shown: The panel of each stream shown, from `shown_streams`.
    """

    def __init__(self, shown: Mapping[str, str]) -> None:
        self.shown = dict(shown)

    def encode(self, sample: Sample) -> list[Piece]:
        """The sample's panel of the film."""
        place = self.shown.get(sample.sensor)
        if place is None or not isinstance(sample, (Image, DepthImage, SemanticImage, PointCloud)):
            return []
        return [Piece(sample.stamp_ns, place, "", panel_of(sample).tobytes())]


class PreviewWriter(Writer):
    """An mp4 with one image per instant of the first stream shown; no film where no stream is shown.

    The film is `target`; one of its images stands beside it as `<stem>.png`.

    Args:
        target: Path of the film.
        encoder: Makes the panels; each has a place in every image.
        rate_hz: Samples of the first of them per second [Hz].
        caption: Title in the film.
    """

    def __init__(
        self, target: str | Path, encoder: PreviewEncoder, *, rate_hz: float, caption: str = ""
    ) -> None:
        super().__init__(target, encoder)
        self._places = tuple(encoder.shown.values())
        self._rate_hz = rate_hz
        self._caption = caption
        self._film: _Film | None = None
        self._panels: dict[str, U8] = {}
        self._still: U8 | None = None
        self._count = 0

    def _begin(self, part: Path) -> None:
        self._film = None

    def _place(self, piece: Piece) -> None:
        if piece.place == self._places[0]:
            self._show()
            # A LiDAR may be slower than the camera: its last sweep stays.
            self._panels = {name: panel for name, panel in self._panels.items() if name == "cloud"}
        self._panels[piece.place] = np.frombuffer(piece.data, np.uint8).reshape(_PANEL_SHAPE)

    def _show(self) -> None:
        if not self._places or self._places[0] not in self._panels:
            return
        image = joined(self._panels, self._places, caption=self._caption)
        if self._film is None:
            self._film = _Film(self._part, image.shape[1], image.shape[0], self._rate_hz)
        self._film.add(image)
        if self._count % _STILL_EVERY == 0:
            self._still = image
        self._count += 1

    def _finish(self) -> None:
        self._show()
        if self._film is None:
            # A stretch without a picture or sweep leaves no film, and no error.
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
        png = png_of(cv2.cvtColor(self._still, cv2.COLOR_RGB2BGR), "the still", ())
        try:
            path.write_bytes(png)
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
        # Imported here: workers that only make units do not need FFmpeg's libraries.
        import av

        rate = Fraction(rate_hz).limit_denominator(1000)
        container = av.open(str(path), "w", format="mp4")
        self._container: OutputContainer | None = container
        self._stream = container.add_stream("libx264", rate=rate, options=_X264)
        self._stream.width, self._stream.height = width_px, height_px
        self._stream.pix_fmt = "yuv420p"

    def add(self, rgb: U8) -> None:
        """Add an image, shape (H, W, 3)."""
        import av

        assert self._container is not None
        frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def complete(self) -> None:
        """Write the delayed frames, and close the file."""
        if self._container is not None:
            container, self._container = self._container, None
            try:
                container.mux(self._stream.encode(None))
            finally:
                container.close()
