"""The event camera: events that pixels fire between a camera's pictures, with memory from one to the next.

The memory begins anew, without firing, every `restart_s` of the drive, so that any stretch of a drive has the
same bytes; each reference then lies anywhere within its thresholds. Flakes of snow fire events
(`flakes`), drops do not.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.samples import EVENT
from carlaloc_env.sensors.camera_config import EventConfig
from carlaloc_env.sensors.event_camera.esim import generate_events
from carlaloc_env.sensors.event_camera.flakes import Flakes, flake_events
from carlaloc_env.sensors.event_camera.pixels import NoiseEvents, PixelState, Thresholds
from carlaloc_env.sensors.event_camera.read_out import limit_rate
from carlaloc_env.sensors.imaging.frame import Optics
from carlaloc_env.sensors.imaging.frame_motion import FrameGeometry, FrameMotion, motion_between
from carlaloc_env.sensors.imaging.state_chain import Chain
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import Weather

RenderFrame = Callable[[int], tuple[FrameGeometry, list[F32], list[Flakes | None]]]
"""Draws the frame of a stamp [ns]: its geometry; log intensity and flakes before it under each weather."""


class EventCamera:
    """The pixels of one event camera; holds what never changes, the caller holds the states."""

    def __init__(self, config: EventConfig, name: str, optics: Optics, seed: int) -> None:
        self.config = config
        self._name, self._seed, self._optics = f"events_{name}", seed, optics
        self._shape = (optics.pinhole.height_px, optics.pinhole.width_px)
        self._thresholds = Thresholds.draw(
            seed, self._name, self._shape, config.threshold_on, config.threshold_off, config.threshold_sigma
        )

    @property
    def restart_ns(self) -> int:
        """Time between two new beginnings [ns]."""
        return round(self.config.restart_s * 1e9)

    def initial_state(self, log_intensity: F32, stamp_ns: int) -> PixelState:
        """State at a moment without history."""
        return PixelState.initial(log_intensity, self._thresholds, self._seed, self._name, stamp_ns)

    def motion(self, before: FrameGeometry, after: FrameGeometry) -> FrameMotion:
        """Motion of everything between two pictures; the same for all weathers."""
        return motion_between(self._optics, before, after)

    def generate(
        self, before: F32, after: F32, motion: FrameMotion, state: PixelState, span_ns: tuple[int, int]
    ) -> tuple[NDArray[np.void], PixelState]:
        """Events between two pictures of log intensity, and the state after them.

        Args:
            before: Log intensity at the beginning, shape (H, W).
            after: Log intensity at the end, shape (H, W).
            motion: From `motion`.
            state: State at the beginning.
            span_ns: Beginning and end [ns].
        """
        config, (start_ns, end_ns) = self.config, span_ns
        span_us = (end_ns - start_ns) // 1000
        noise = NoiseEvents.draw(self._seed, self._name, end_ns, self._shape, config.shot_hz, span_us)
        events, state = generate_events(
            before,
            after,
            motion,
            state,
            self._thresholds,
            noise,
            start_ns=start_ns,
            span_us=span_us,
            refractory_us=config.refractory_us,
            leak_hz=config.leak_hz,
            step_px=config.step_px,
        )
        if start_ns // self.restart_ns < end_ns // self.restart_ns:
            state = self.initial_state(after, end_ns)
        return events, state

    def among_flakes(
        self,
        events: NDArray[np.void],
        flakes: Flakes | None,
        ends: tuple[FrameGeometry, FrameGeometry],
        log_intensity: F32,
        span_ns: tuple[int, int],
    ) -> NDArray[np.void]:
        """Events as the chip reads them out, by time: those of the scene, and of flakes before it."""
        config, (start_ns, end_ns) = self.config, span_ns
        if flakes is not None:
            fired = flake_events(
                flakes, ends, log_intensity, self._thresholds, self._optics, dark_cd_m2=config.dark_cd_m2,
                start_ns=start_ns, span_us=(end_ns - start_ns) // 1000, refractory_us=config.refractory_us,
            )  # fmt: skip
            events = np.concatenate([events, fired])
            events = events[np.argsort(events["t"], kind="stable")]
        if config.rate_max_mev_s > 0:
            events = limit_rate(events, start_ns, 1e6 * config.rate_max_mev_s)
        return events


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Held:
    stamp_ns: int
    geometry: FrameGeometry
    intensity: list[F32]
    states: list[PixelState]
    events: list[NDArray[np.void]]


class EventChain:
    """Events of picture after picture under several weathers, whatever the order they are asked for in."""

    def __init__(self, camera: EventCamera, period_ns: int) -> None:
        self._camera = camera
        self._chain: Chain[_Held] = Chain(period_ns, camera.restart_ns)

    def events(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather], render: RenderFrame
    ) -> list[NDArray[np.void]]:
        """Events of the period that ends at a stamp [ns], for each weather.

        There are none at the first picture of a drive, nor at the oldest one that a timeline knows.
        """
        return self._chain.at(timeline, stamp_ns, tuple(weathers), *self._steps(render)).events

    def towards(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather], render: RenderFrame
    ) -> Iterator[int]:
        """Stamps of the pictures that are missing up to one, see `Chain.towards`."""
        return self._chain.towards(timeline, stamp_ns, tuple(weathers), *self._steps(render))

    def _steps(self, render: RenderFrame) -> tuple[Callable[[int], _Held], Callable[[_Held, int], _Held]]:
        """Functions that make a state without history, and the state one period after another."""

        def begin(at_ns: int) -> _Held:
            geometry, intensity, _ = render(at_ns)
            states = [self._camera.initial_state(seen, at_ns) for seen in intensity]
            none = [np.zeros(0, EVENT) for _ in intensity]
            return _Held(stamp_ns=at_ns, geometry=geometry, intensity=intensity, states=states, events=none)

        def follow(held: _Held, at_ns: int) -> _Held:
            geometry, intensity, flakes = render(at_ns)
            motion = self._camera.motion(held.geometry, geometry)
            fired = [
                self._camera.generate(before, after, motion, state, (held.stamp_ns, at_ns))
                for before, after, state in zip(held.intensity, intensity, held.states, strict=True)
            ]
            ends, span_ns = (held.geometry, geometry), (held.stamp_ns, at_ns)
            events = [
                self._camera.among_flakes(rows, falling, ends, seen, span_ns)
                for (rows, _), falling, seen in zip(fired, flakes, intensity, strict=True)
            ]
            states = [state for _, state in fired]
            return _Held(stamp_ns=at_ns, geometry=geometry, intensity=intensity, states=states, events=events)

        return begin, follow
