"""Shows a drive in a window: live view, instruments, small map."""

import math
import time
from collections import deque
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import TICK_HZ
from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.actors import LIGHT_LEFT, LIGHT_RIGHT
from carlaloc_env.timeline.snapshot import Snapshot, is_blink
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.signals import SignalState
from carlaloc_env.weather.schedule import Weather
from recorder.window.drive_status import DriveStatus
from recorder.window.hud import HudState
from recorder.window.mini_map import MiniMap
from recorder.window.render_process import GONE, RenderProcess
from recorder.window.window import WINDOW_PX, Window

VIEWS = ("seat", "chase", "above")
"""Cameras in the order in which the driver switches through them."""
_INDICATORS = {"left": LIGHT_LEFT, "right": LIGHT_RIGHT}
_IMAGE_S = 0.003
"""How long to wait for an image before the world moves on [s]."""
_FIRST_S = 30.0
"""How long to wait for the first image, for which shaders are compiled [s]."""
_RATED_IMAGES = 20
"""Images over which their rate is taken."""
_GONE_S = 0.03
"""Time between two views of the instruments when there are no more images [s]."""
_ARROW_AHEAD_S, _ARROW_AHEAD_MIN_M = 3.0, 18.0


def present_of(world: DrivingWorld, status: DriveStatus) -> Snapshot:
    """The present of a world, with the ego's indicators and headlamps as its driver has switched them."""
    snapshot = Snapshot.of(world.timeline, world.now_ns)
    indicator = _INDICATORS.get(status.indicator, 0) if is_blink(snapshot.stamp_ns) else 0
    return replace(snapshot, ego_lights=snapshot.ego_lights | indicator, ego_headlamps=status.headlamps)


class WindowCockpit(AbstractContextManager["WindowCockpit"]):
    """Shows a drive in a window; a context manager that ends the drawing.

    Args:
        window: Where it is shown.
    """

    def __init__(self, window: Window) -> None:
        self.window = window
        self._renderer = RenderProcess()
        self._map: MiniMap | None = None
        self._last: NDArray[np.uint8] | None = None
        self._shown: tuple[object, ...] = ()
        self.images = 0
        """Images shown so far."""
        self._shown_s: deque[float] = deque(maxlen=_RATED_IMAGES)

    def prepare(self, town: Town, weather: Weather) -> None:
        """Hand town and weather to the process that draws; it makes the scene meanwhile."""
        self._renderer.prepare(SensorStage(town, seed=0, weather=weather, quality="low"))

    def wait_for_first(self, world: DrivingWorld, status: DriveStatus) -> None:
        """Wait for the first image, so that no person drives blind.

        Raises:
            RenderError: there is no OpenGL, or the process that draws ended.
        """
        self._renderer.wait_until_ready()
        self._renderer.ask(present_of(world, status), VIEWS[status.view % len(VIEWS)])
        self._take(_FIRST_S)

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    @property
    def is_live(self) -> bool:
        """Whether images are still to come."""
        return self._renderer.alive

    def show(self, world: DrivingWorld, status: DriveStatus) -> None:
        """Show the present: order an image of it, and show the one ordered before when it is drawn."""
        view = VIEWS[status.view % len(VIEWS)]
        image = self._take(_IMAGE_S)
        if self._renderer.idle:
            self._renderer.ask(present_of(world, status), view)
        if not self._renderer.alive:
            status.message = GONE
            time.sleep(_GONE_S)
        # Between two images only messages to the driver, and what the driver has asked for, are shown.
        now_shown = (status.message, status.paused, status.help, status.indicator, status.headlamps)
        if self._last is not None and (
            image is not None or now_shown != self._shown or not self._renderer.alive
        ):
            self._shown = now_shown
            self._show(self._last, world, status, view)

    def photo(self, world: DrivingWorld, status: DriveStatus, path: Path) -> None:
        """Draw the present with every pixel of the window and no instruments, and write it to a PNG.

        Raises:
            OutputError: it cannot be written, or there are no more pictures.
        """
        # The image that is being drawn is in the way.
        self._take(None)
        self._renderer.ask(present_of(world, status), VIEWS[status.view % len(VIEWS)], photo=True)
        drawn = self._renderer.image(None)
        if drawn is None:
            raise OutputError("the drawing process has ended")
        image = cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR)
        with atomic_write(path) as part:
            part.write_bytes(cv2.imencode(".png", image)[1].tobytes())

    def _take(self, patience_s: float | None) -> NDArray[np.uint8] | None:
        """The image that was ordered, when it is drawn in time."""
        image = self._renderer.image(patience_s)
        if image is not None:
            self._last = image.copy()
            self.images += 1
            self._shown_s.append(time.monotonic())
        return image

    def _show(self, image: NDArray[np.uint8], world: DrivingWorld, status: DriveStatus, view: str) -> None:
        if self._map is None:
            self._map = MiniMap(world.town.network, world.route, size_px=WINDOW_PX[1] // 3)
        driver = world.driver_view()
        actors = world.timeline.actors_at(world.now_ns)
        small = self._map.image(driver.position_m, driver.heading_rad, actors)
        self.window.show(image, self._state(world, status, view), small)

    def _state(self, world: DrivingWorld, status: DriveStatus, view: str) -> HudState:
        driver, route = world.driver_view(), world.route
        driven_m = max(driver.route_s_m, 0.0)
        passed_s = self._shown_s[-1] - self._shown_s[0] if len(self._shown_s) > 1 else math.inf
        ahead_m = max(_ARROW_AHEAD_MIN_M, _ARROW_AHEAD_S * driver.speed_mps)
        target = route.at(driver.route_s_m + ahead_m).position_m[0] - driver.position_m
        turn = math.atan2(target[1], target[0]) - driver.heading_rad
        return HudState(
            status=status,
            speed_mps=driver.speed_mps,
            limit_mps=driver.speed_limit_mps,
            turn_deg=float(np.degrees(math.remainder(turn, 2.0 * math.pi))),
            remaining_m=route.length_m - (driven_m % route.length_m if route.closed else driven_m),
            driven_m=driven_m,
            light=SignalState(driver.signal_state).name.lower(),
            light_m=driver.stop_line_distance_m,
            time_s=world.tick_count / TICK_HZ,
            view=view,
            pictures_hz=(len(self._shown_s) - 1) / passed_s,
        )
