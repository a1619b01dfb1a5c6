"""What cameras put out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples.base import Sample, check_arrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Image(Sample):
    """A colour picture."""

    rgb: NDArray[np.uint8]
    """sRGB values 0–255, shape (H, W, 3)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.uint8, (None, None, 3), "rgb")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class DepthImage(Sample):
    """Distance along the optical axis of every pixel."""

    depth_m: NDArray[np.float32]
    """Planar depth z [m], 0 = sky, shape (H, W)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float32, (None, None), "depth_m")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SemanticImage(Sample):
    """Tag and instance of every pixel."""

    tag: NDArray[np.uint8]
    """`Tag` of the surface, no unit, shape (H, W)."""
    instance: NDArray[np.uint32]
    """Instance id, 0 = none, shape (H, W)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.uint8, (None, None), "tag")
        check_arrays(self, np.uint32, (None, None), "instance")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FlowImage(Sample):
    """Optical flow: motion of every pixel's surface point until the camera's next picture."""

    flow_px: NDArray[np.float32]
    """Rightwards and downwards [px], of the sky by the camera's turning alone, shape (H, W, 2)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float32, (None, None, 2), "flow_px")

    def observed(self) -> NDArray[np.float32]:
        """The flow [px]."""
        return self.flow_px


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class NormalImage(Sample):
    """Surface normals of every pixel, towards the camera."""

    normal: NDArray[np.float32]
    """Unit shading normal in the optical frame, zero for the sky, shape (H, W, 3)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float32, (None, None, 3), "normal")

    def observed(self) -> NDArray[np.float32]:
        """The normals."""
        return self.normal


EVENT = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""One event, 13 bytes: time since the drive began [ns], column, row [px], 1 = brighter or 0 = darker."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Events(Sample):
    """Events of an event camera in one period; `stamp_ns` is the end of the period."""

    events: NDArray[np.void]
    """Rows of `EVENT`, none later than `stamp_ns`, ordered by time, shape (N,)."""
    width_px: int
    """Width of the sensor [px]."""
    height_px: int
    """Height of the sensor [px]."""
    period_ns: int
    """Length of the period [ns]; all events lie after its beginning."""

    def __post_init__(self) -> None:
        if self.events.dtype != EVENT or self.events.ndim != 1:
            raise ValueError(f"Events.events is {self.events.dtype}{list(self.events.shape)}, not EVENT[N]")

    def observed(self) -> NDArray[np.uint8]:
        """Counts of brighter and darker events per pixel, 255 = 255 or more, shape (H, W, 2)."""
        e = self.events
        flat = (e["y"].astype(np.int64) * self.width_px + e["x"]) * 2 + (1 - e["p"].astype(np.int64))
        counts = np.bincount(flat, minlength=2 * self.width_px * self.height_px)
        shape = (self.height_px, self.width_px, 2)
        return np.minimum(counts, 255).astype(np.uint8).reshape(shape)
