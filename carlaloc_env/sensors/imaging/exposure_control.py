"""From drawn pictures to a camera's: exposure control, shutter and imager together.

Memory of sensors that are asked for any stamp in any order.

What such a sensor remembers begins anew at fixed times of the drive. For the stamp after the
last one the sensor continues from there; for any other it first goes over the drive from the last such
beginning. So the state at a stamp depends on the drive alone, not on what was asked before.
"""

import weakref
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.sensors.camera_config import ImagerConfig, ShutterConfig, beginning_ns, rounded_up_ns
from carlaloc_env.sensors.imaging.frame import Frame, FrameGeometry, FrameMotion, Optics, motion_between
from carlaloc_env.sensors.imaging.imager import Imager, exposed, picked
from carlaloc_env.sensors.imaging.motion_field import ScenePoses
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import Weather

S = TypeVar("S")


class Chain(Generic[S]):
    """States at stamps on a grid, each made from the one before."""

    def __init__(self, period_ns: int, restart_ns: int) -> None:
        """Make an empty chain.

        Args:
            period_ns: Time between two states [ns].
            restart_ns: States at its multiples do not depend on earlier ones [ns].
        """
        self._period_ns = period_ns
        self._restart_ns = restart_ns
        self._held: tuple[weakref.ref[Timeline], Hashable, int, S] | None = None

    def at(
        self,
        timeline: Timeline,
        stamp_ns: int,
        key: Hashable,
        begin: Callable[[int], S],
        follow: Callable[[S, int], S],
    ) -> S:
        """State at a stamp [ns].

        Args:
            timeline: The drive; the oldest stamp that it knows is a beginning too.
            stamp_ns: A multiple of the period [ns].
            key: What else the state depends on, e.g. the weathers.
            begin: Makes the state at a stamp without history.
            follow: Makes the state at a stamp from that one period before; at a multiple of the
                restart it must forget by itself.
        """
        for _ in self.towards(timeline, stamp_ns, key, begin, follow):
            pass
        state = self._kept(timeline, stamp_ns, key)
        assert state is not None
        return state

    def towards(
        self,
        timeline: Timeline,
        stamp_ns: int,
        key: Hashable,
        begin: Callable[[int], S],
        follow: Callable[[S, int], S],
    ) -> Iterator[int]:
        """Stamps of the states that are missing up to one [ns]; each is made when the next is asked for.

        Takes the arguments of `at`, which continues from the last state that was made.
        """
        if self._kept(timeline, stamp_ns, key) is not None:
            return
        before_ns = stamp_ns - self._period_ns
        state = self._kept(timeline, before_ns, key)
        if state is not None:
            next_ns = stamp_ns
        else:
            first_ns = beginning_ns(stamp_ns, self._period_ns, self._restart_ns)
            oldest_ns = rounded_up_ns(timeline.start_ns, self._period_ns)
            next_ns = stamp_ns if before_ns < oldest_ns else max(first_ns, oldest_ns)
        for at_ns in range(next_ns, stamp_ns + 1, self._period_ns):
            yield at_ns
            state = begin(at_ns) if state is None else follow(state, at_ns)
            self._held = (weakref.ref(timeline), key, at_ns, state)

    def _kept(self, timeline: Timeline, stamp_ns: int, key: Hashable) -> S | None:
        if self._held is None:
            return None
        of, held_key, held_ns, state = self._held
        return state if of() is timeline and held_key == key and held_ns == stamp_ns else None


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
    """What lies between the first and the last light of a picture."""

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
        found = []
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
            if now.precipitation > 0.0:
                # Drops fall across the motion of surfaces: they are drawn where the exposure ends.
                light = draw(stamp_ns)[0].rained_cd_m2(
                    light, now, stamp_ns=stamp_ns, exposure_s=exposure_s, seed=self._seed
                )
            found.append(self._imager.picture(light, product_s, stamp_ns))
        return found

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
