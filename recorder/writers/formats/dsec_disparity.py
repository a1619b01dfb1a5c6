"""True disparity of the left event camera in the layout of the DSEC data set (dsec.ifi.uzh.ch/data-format).

``event/%06d.png`` has 16 bits, disparity [px] · 256, 0 where nothing is known; ``timestamps.txt`` is in µs.
Both cameras look in the same direction, so that pictures are rectified.
"""

from pathlib import Path

import numpy as np

from carlaloc_env.samples import DepthImage, Sample
from recorder.writers.base import Encoder, Piece, Writer, png_of
from recorder.writers.rig_calibration import RigCalibration


class DsecDisparityEncoder(Encoder):
    """Disparity from the left camera's depth: focal length · baseline / depth.

    Args:
        calibration: The rig; its first two cameras are the pair.
    """

    def __init__(self, calibration: RigCalibration) -> None:
        left, right = calibration.cameras[:2]
        self._stream = f"depth_{left.name}"
        baseline_m = float(calibration.T(left.frame, right.frame)[0, 3])
        self._scale = 256.0 * left.pinhole.fx_px * baseline_m

    def encode(self, sample: Sample) -> list[Piece]:
        """A depth image as PNG."""
        if not isinstance(sample, DepthImage) or sample.sensor != self._stream:
            return []
        with np.errstate(divide="ignore"):
            disparity = np.where(sample.depth_m > 0, self._scale / sample.depth_m, 0.0)
        png = png_of(np.clip(np.rint(disparity), 0, 65535).astype(np.uint16), sample.sensor, ())
        return [Piece(sample.stamp_ns, "disparity", "png", png)]


class DsecDisparityWriter(Writer):
    """Pictures of disparity and their times."""

    def __init__(self, target: str | Path, encoder: DsecDisparityEncoder) -> None:
        super().__init__(target, encoder)
        self._count = 0

    def _begin(self, part: Path) -> None:
        (part / "event").mkdir(parents=True)
        self._files["stamps"] = (part / "timestamps.txt").open("x", encoding="utf-8")

    def _place(self, piece: Piece) -> None:
        (self._part / "event" / f"{self._count:06d}.png").write_bytes(piece.data)
        self._files["stamps"].write(f"{self.encoder.unix_ns(piece.stamp_ns) // 1000}\n")
        self._count += 1
