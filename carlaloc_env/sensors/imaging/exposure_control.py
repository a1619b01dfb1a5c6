"""From drawn pictures to a camera's: exposure control, shutter and imager together."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.sensors.camera_config import ImagerConfig, ShutterConfig
from carlaloc_env.sensors.imaging.frame import Frame, Optics
from carlaloc_env.sensors.imaging.frame_motion import FrameGeometry, FrameMotion, motion_between
from carlaloc_env.sensors.imaging.imager import Imager
from carlaloc_env.sensors.imaging.motion_field import ScenePoses
from carlaloc_env.sensors.imaging.shutter import exposed, picked
from carlaloc_env.sensors.imaging.state_chain import Chain
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import Weather

Draw = Callable[[int], tuple[Frame, ScenePoses]]
"""Draws what the camera sees at a time [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Metered:
    stamp_ns: int
    products_s: list[float]
    """Exposure times gain of the picture at the stamp, for each weather."""
    levels_cd_m2: list[float]
    """Mean luminance of that picture, by which the next one is exposed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Swept:
    """Pictures at the first and the last light of a picture, and the motion between them."""

    begin_ns: int
    """Time of the first drawn picture [ns]."""
    end_ns: int
    """Time of the second one [ns]."""
    first: Frame
    """The first picture."""
    second: Frame
    """The second one."""
    motion: FrameMotion
    """Motion in between."""

    def shares(self, rows_ns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Times of rows [ns] as shares of the time between the pictures."""
        return (rows_ns - self.begin_ns) / max(self.end_ns - self.begin_ns, 1)


class Imaging:
    """An imager with its control and shutter, behind one camera's optics."""

    def __init__(
        self,
        imager: ImagerConfig,
        shutter: ShutterConfig | None,
        name: str,
        optics: Optics,
        period_ns: int,
        seed: int,
    ) -> None:
        shape = (optics.pinhole.height_px, optics.pinhole.width_px)
        self._imager = Imager(imager, name, shape, seed)
        self._shutter, self._optics, self._shape = shutter, optics, shape
        self._period_ns, self._seed = period_ns, seed
        self._restart_ns = round(1e9 * imager.restart_s)
        self._chain: Chain[_Metered] = Chain(period_ns, self._restart_ns)

    def pictures(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather], draw: Draw, swept: Swept | None
    ) -> list[NDArray[np.uint8]]:
        """Colour pictures of one stamp, one per weather, shape (H, W, 3).

        Args:
            timeline: The drive.
            stamp_ns: Middle of the exposure [ns].
            weathers: Weathers.
            draw: Draws the camera's view.
            swept: From `sweep`; None: the shutter is infinitely fast.
        """
        images = []
        config = self._imager.config
        metered = self._chain.at(timeline, stamp_ns, tuple(weathers), *self._steps(weathers, draw))
        for weather, product_s in zip(weathers, metered.products_s, strict=True):
            now, exposure_s = weather.at(stamp_ns), config.split(product_s)[0]
            if swept is None or self._shutter is None:
                light = draw(stamp_ns)[0].imaged_cd_m2(now)
            else:
                rows_ns = self._shutter.rows_ns(stamp_ns, exposure_s, self._shape[0])
                ends = swept.first.imaged_cd_m2(now), swept.second.imaged_cd_m2(now)
                light = exposed(*ends, swept.motion, swept.shares(rows_ns))
            if now.falls:
                # Drops fall across the motion of surfaces: they are drawn where the exposure ends.
                light = draw(stamp_ns)[0].rained_cd_m2(
                    light, now, stamp_ns=stamp_ns, exposure_s=exposure_s, seed=self._seed
                )
            images.append(self._imager.picture(light, product_s, stamp_ns))
        return images

    def sweep(self, timeline: Timeline, stamp_ns: int, draw: Draw) -> Swept | None:
        """Pictures at the first and last light of a picture; None: the shutter is infinitely fast."""
        if self._shutter is None:
            return None
        half_ns = self._shutter.span_ns(self._imager.config.exposure_max_ms) // 2
        begin_ns, end_ns = (
            max(stamp_ns - half_ns, timeline.start_ns),
            min(stamp_ns + half_ns, timeline.end_ns),
        )
        if begin_ns >= end_ns:
            return None
        first, second = draw(begin_ns), draw(end_ns)
        motion = motion_between(self._optics, FrameGeometry.of(*first), FrameGeometry.of(*second))
        return Swept(begin_ns=begin_ns, end_ns=end_ns, first=first[0], second=second[0], motion=motion)

    def rolled(
        self, stamp_ns: int, swept: Swept | None
    ) -> tuple[F32, NDArray[np.uint8], NDArray[np.uint32]] | None:
        """Depth [m], tag and instance of every row at its own time; None: all rows at the stamp."""
        if swept is None or self._shutter is None or self._shutter.readout_ms == 0:
            return None
        shares = swept.shares(self._shutter.rows_ns(stamp_ns, 0.0, self._shape[0]))
        s = np.clip(shares.mean(axis=1), 0.0, 1.0).astype(np.float32)[:, None]
        first_m = swept.first.depth_m * (1 - s + s * swept.motion.forward[..., 2])
        second_m = swept.second.depth_m * (s + (1 - s) * swept.motion.backward[..., 2])
        (tag_0, instance_0), (tag_1, instance_1) = swept.first.labels, swept.second.labels
        tag = picked(tag_0, tag_1, swept.motion, shares)
        instance = picked(instance_0, instance_1, swept.motion, shares)
        return picked(first_m, second_m, swept.motion, shares), tag, instance

    def towards(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather], draw: Draw
    ) -> Iterator[int]:
        """Stamps of the pictures that are missing up to one, see `Chain.towards`."""
        return self._chain.towards(timeline, stamp_ns, tuple(weathers), *self._steps(weathers, draw))

    def _steps(
        self, weathers: Sequence[Weather], draw: Draw
    ) -> tuple[Callable[[int], _Metered], Callable[[_Metered, int], _Metered]]:
        """Functions that make a state without history, and the state one period after another."""
        config = self._imager.config

        def levels(at_ns: int) -> list[float]:
            frame = draw(at_ns)[0]
            return [self._imager.level_cd_m2(frame.radiance_cd_m2(weather.at(at_ns))) for weather in weathers]

        def begin(at_ns: int) -> _Metered:
            seen = levels(at_ns)
            settled = [config.settled(level) for level in seen]
            return _Metered(stamp_ns=at_ns, products_s=settled, levels_cd_m2=seen)

        def follow(held: _Metered, at_ns: int) -> _Metered:
            if held.stamp_ns // self._restart_ns < at_ns // self._restart_ns:
                return begin(at_ns)
            products = [
                config.controlled(product, level, 1e-9 * self._period_ns)
                for product, level in zip(held.products_s, held.levels_cd_m2, strict=True)
            ]
            return _Metered(stamp_ns=at_ns, products_s=products, levels_cd_m2=levels(at_ns))

        return begin, follow
