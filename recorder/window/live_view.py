"""Draws the driver's view: from the seat, from behind the car, or from above it."""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation, quat_to_matrix, rpy_to_quat
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.snapshot import Snapshot
from recorder.window.live_resolution import SIZES_PX, LiveResolution

if TYPE_CHECKING:
    # Drives without a window need no OpenGL.
    from carlaloc_env.render.geometry.gbuffer import GBuffer

_CHASE_TURN = 0.06
_FOV_DEG = {"seat": 80.0, "chase": 75.0, "above": 60.0}


class LiveView:
    """Draws the driver's view, in low resolution and at the renderer's lowest tier.

    Images become smaller where the machine would not draw twenty a second.

    Args:
        stage: Town, weather and renderer.
    """

    def __init__(self, stage: SensorStage) -> None:
        self._stage = stage
        self._resolution = LiveResolution()
        self._heading_rad: float | None = None
        self._last: GBuffer | None = None
        self._finished: GBuffer | None = None
        self._unfinished: Callable[[], NDArray[np.uint8]] | None = None
        self._view = ""

    def image(self, snapshot: Snapshot, view: str, hand_over: Callable[[NDArray[np.uint8]], None]) -> None:
        """Draw an instant, and hand over the image of the one drawn before.

        The first one is handed over twice. Each image is shaded on some cores while it is worked out
        what the next one shows, and handed over before the next one's triangles are sorted out.

        Args:
            snapshot: What to draw.
            view: One of `snapshot.VIEWS`.
            hand_over: Called once with a colour image, sRGB, shape (H, W, 3), C-contiguous.
        """
        began = time.perf_counter()
        renderer, now = self._stage.renderer(), snapshot.stamp_ns
        seen = self._seen(snapshot, view, self._resolution.size_px)
        earlier = self._finished if view == self._view else None
        draw = renderer.begin_drawing(*seen, earlier=earlier)
        is_first = self._unfinished is None
        if self._unfinished is not None:
            hand_over(np.ascontiguousarray(self._unfinished()))
        # The next image hides surfaces by a finished one, which costs no waiting.
        self._finished = self._last if view == self._view else None
        if self._finished is not None:
            self._finished.samples()
        drawn = draw()
        weather = self._stage.weather.at(now)
        self._unfinished = renderer.begin_shading(drawn, weather, stamp_ns=now, seed=self._stage.seed)
        self._last, self._view = drawn, view
        if is_first:
            hand_over(np.ascontiguousarray(self._unfinished()))
        self._resolution.took(time.perf_counter() - began)

    def photo(self, snapshot: Snapshot, view: str, hand_over: Callable[[NDArray[np.uint8]], None]) -> None:
        """Draw an instant alone, in the largest size; takes the arguments of `image`."""
        renderer, now = self._stage.renderer(), snapshot.stamp_ns
        drawn = renderer.draw(*self._seen(snapshot, view, SIZES_PX[0]))
        weather = self._stage.weather.at(now)
        # A live image may be unfinished in the first slot.
        shade = renderer.begin_shading(drawn, weather, stamp_ns=now, seed=self._stage.seed, slot=1)
        hand_over(np.ascontiguousarray(shade()))

    def _seen(
        self, snapshot: Snapshot, view: str, size_px: tuple[int, int]
    ) -> tuple[Pinhole, Array, Instances]:
        """Lens, pose and movable models of an image."""
        lens = Pinhole.from_fov(*size_px, _FOV_DEG[view])
        instances = instances_at(self._stage.library, self._stage.lenses, snapshot)
        return lens, self._pose(snapshot.T_world_base, view), instances

    def _pose(self, T_world_base: Array, view: str) -> Array:
        """Pose of the optical frame (4, 4) in the world."""
        if view == "seat":
            return T_world_base @ _placed((1.75, 0.0, 1.45), pitch_rad=0.04)
        heading = math.atan2(T_world_base[1, 0], T_world_base[0, 0])
        # The chase camera swings after the car, as a following eye does.
        yaw = heading if self._heading_rad is None else self._heading_rad
        yaw += math.remainder(heading - yaw, 2.0 * math.pi) * (1.0 if view == "above" else _CHASE_TURN)
        self._heading_rad = yaw
        turn = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.0, yaw)), T_world_base[:3, 3])
        if view == "chase":
            return turn @ _placed((-5.5, 0.0, 2.9), pitch_rad=0.14)
        return turn @ _placed((6.0, 0.0, 32.0), pitch_rad=math.pi / 2)


def _placed(position_m: tuple[float, float, float], *, pitch_rad: float) -> Array:
    """Pose of an optical frame in an FLU frame, nose down positive."""
    return from_rotation(quat_to_matrix(rpy_to_quat(0.0, pitch_rad, 0.0)) @ R_FLU_OPTICAL, position_m)
