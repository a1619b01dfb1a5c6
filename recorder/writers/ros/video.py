"""H.264 for `foxglove_msgs/CompressedVideo`: each message holds a picture that can be shown at once."""

from fractions import Fraction

import numpy as np

CRF = 18
"""Quality of x264: pictures of a drive keep about 38 dB."""


class VideoEncoder:
    """One stream: Annex B, a keyframe with its parameter sets every second, no B-frames.

    Args:
        width_px: Width, even [px].
        height_px: Height, even [px].
        rate_hz: Pictures a second [Hz].
    """

    def __init__(self, width_px: int, height_px: int, rate_hz: float) -> None:
        # Imported here: profiles without video do without FFmpeg's libraries.
        import av

        period = round(rate_hz) or 1
        codec = av.CodecContext.create("libx264", "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = width_px, height_px, "yuv420p"
        codec.framerate = Fraction(rate_hz).limit_denominator(1000)
        codec.time_base = 1 / codec.framerate
        # One thread: bytes must not depend on the machine's cores.
        codec.options = {
            "preset": "veryfast",
            "tune": "zerolatency",
            "crf": str(CRF),
            "x264-params": f"keyint={period}:min-keyint={period}:scenecut=0:repeat-headers=1:annexb=1:"
            "threads=1:colorprim=bt709:transfer=bt709:colormatrix=bt709",
        }
        self._codec, self._shape, self._count = codec, (height_px * 3 // 2, width_px), 0

    def encode(self, planes: bytes) -> bytes:
        """The next picture, from its planes in 4:2:0.

        Raises:
            ValueError: they are not of the stream's size.
        """
        import av

        frame = av.VideoFrame.from_ndarray(
            np.frombuffer(planes, np.uint8).reshape(self._shape), format="yuv420p"
        )
        frame.pts = self._count
        self._count += 1
        return b"".join(bytes(packet) for packet in self._codec.encode(frame))
