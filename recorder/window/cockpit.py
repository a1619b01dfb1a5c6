"""Shows a drive in a window: live view, instruments, small map."""

from __future__ import annotations

import math
import time
from contextlib import AbstractContextManager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import TICK_HZ
from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.output_paths import atomic_write
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.town import Town
from carlaloc_env.weather.schedule import Weather
from recorder.window.hud import HudState
from recorder.window.minimap import MiniMap
from recorder.window.render_process import GONE, RenderProcess
from recorder.window.snapshot import VIEWS, present_of
from recorder.window.status import DriveStatus
from recorder.window.window import WINDOW_PX, Window

_IMAGE_S = 0.003
"""How long to wait for an image before the world moves on [s]."""
_FIRST_S = 30.0
"""How long to wait for the first image, for which shaders are compiled [s]."""
_GONE_S = 0.03
"""Time between two views of the instruments when there are no more images [s]."""
_ARROW_AHEAD_S, _ARROW_AHEAD_MIN_M = 3.0, 18.0


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

    def photo(self, path: Path) -> None:
        """Write the picture without its instruments to a PNG, as large as the window shows it.

        Raises:
            OutputError: it cannot be written, or there has been no picture.
        """
        if self._last is None:
            raise OutputError("there is no picture yet")
        image = cv2.cvtColor(self.window.scaled(self._last), cv2.COLOR_RGB2BGR)
        with atomic_write(path) as part:
            part.write_bytes(cv2.imencode(".png", image)[1].tobytes())

    def _take(self, patience_s: float) -> NDArray[np.uint8] | None:
        """The image that was ordered, when it is drawn in time."""
        image = self._renderer.image(patience_s)
        if image is not None:
            self._last = image.copy()
            self.images += 1
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
        ahead_m = max(_ARROW_AHEAD_MIN_M, _ARROW_AHEAD_S * driver.speed_mps)
        target = route.at(driver.route_s_m + ahead_m).position_m[0] - driver.position_m
        turn = math.atan2(target[1], target[0]) - driver.heading_rad
        return HudState(
            status=status,
            speed_mps=driver.speed_mps,
            limit_mps=driver.speed_limit_mps,
            turn_deg=float(np.degrees(math.remainder(turn, 2.0 * math.pi))),
            remaining_m=route.length_m - driver.route_s_m,
            driven_m=driver.route_s_m,
            light=driver.signal_state,
            light_m=driver.stop_line_distance_m,
            time_s=world.tick_count / TICK_HZ,
            view=view,
        )
