"""Window that shows pictures as they come, for `render_mode` human, and the driver's view in it."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import RenderError
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation, quat_to_matrix, rpy_to_quat
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import Weather

_T_BASE_SEAT = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.03, 0.0)) @ R_FLU_OPTICAL, (1.8, 0.0, 1.65))


class HumanWindow:
    """One window; shows at most its rate of pictures a second, as people watch."""

    def __init__(self, size_px: tuple[int, int], rate_hz: float) -> None:
        """Open it.

        Args:
            size_px: Width and height.
            rate_hz: Pictures a second.

        Raises:
            RenderError: there is no display.
        """
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame: Any = pygame
        self._rate_hz = rate_hz
        pygame.display.init()
        if pygame.display.get_driver() in ("offscreen", "dummy") and "SDL_VIDEODRIVER" not in os.environ:
            pygame.display.quit()
            raise RenderError("render_mode 'human' needs a display; set DISPLAY, or use 'rgb_array'")
        self._screen = pygame.display.set_mode(size_px)
        pygame.display.set_caption("CarlaLoc")
        self._clock = pygame.time.Clock()

    def show(self, rgb: NDArray[np.uint8]) -> None:
        """Show a picture, sRGB, shape (H, W, 3)."""
        pygame = self._pygame
        pygame.event.pump()
        self._screen.blit(pygame.surfarray.make_surface(rgb.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._rate_hz)

    def close(self) -> None:
        """Close it."""
        self._pygame.display.quit()


def view_from_seat(
    stage: SensorStage, timeline: Timeline, stamp_ns: int, weather: Weather
) -> NDArray[np.uint8]:
    """A picture from the driver's seat at a time, sRGB, shape (360, 640, 3).

    Raises:
        RenderError: OpenGL is missing on this machine.
    """
    renderer, snapshot = stage.renderer(), Snapshot.of(timeline, stamp_ns)
    instances = instances_at(stage.library, stage.lenses, snapshot)
    picture = renderer.draw(Pinhole.from_fov(640, 360, 90.0), snapshot.T_world_base @ _T_BASE_SEAT, instances)
    return renderer.shade(picture, weather.at(stamp_ns), stamp_ns=stamp_ns, seed=stage.seed)
