"""Images drawn in a process of their own, so that drawing and driving share no processor core.

Where the driver looks from: the seat, behind the car, above it.

Size of the live images: as large as the machine can draw in time, at most every pixel of the window.
"""

import math
import os
import signal
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import CarlaLocError, RenderError
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation, quat_to_matrix, rpy_to_quat
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.snapshot import Snapshot

if TYPE_CHECKING:
    # Drives without a window need no OpenGL.
    from carlaloc_env.render.geometry.gbuffer import GBuffer

SIZES_PX = tuple((16 * k, 9 * k) for k in (60, 54, 48, 44, 40, 36, 33, 30, 27, 25))
"""Width and height of live images before they are scaled to the window, largest first [px].

Smaller ones would be too coarse to read, and drawn hardly sooner.
"""
FIRST_PX = (480, 270)
"""Size of the first images."""
BUDGET_S = 0.044
"""Time for one image; twenty a second leave 6 ms for what the drive itself needs [s]."""
_SETTLE = 8
"""Images between two changes: the first ones of a size are slower."""
_MOST_PATIENCE = 256
"""Most images before the size grows again; each time it had to shrink they double, against flicker."""
_SMOOTHING = 0.25


class LiveResolution:
    """Chooses among `SIZES_PX` by the time that images took.

    Args:
        budget_s: Time that an image may take [s].
    """

    def __init__(self, budget_s: float = BUDGET_S) -> None:
        self._budget_s = budget_s
        self._index = SIZES_PX.index(FIRST_PX)
        self._drawn = 0
        self._patience = _SETTLE
        self._smooth_s = 0.0

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the next image [px]."""
        return SIZES_PX[self._index]

    def took(self, seconds: float) -> None:
        """Take note of how long the last image took [s]."""
        self._drawn += 1
        if self._drawn <= _SETTLE // 2:
            self._smooth_s = seconds
            return
        self._smooth_s += _SMOOTHING * (seconds - self._smooth_s)
        if self._drawn < _SETTLE:
            return
        if self._smooth_s > self._budget_s and self.size_px != SIZES_PX[-1]:
            self._patience = min(2 * self._patience, _MOST_PATIENCE)
            self._choose(self._largest(self._budget_s))
        elif self._drawn >= self._patience:
            self._choose(min(self._index, self._largest(0.9 * self._budget_s)))

    def _largest(self, budget_s: float) -> int:
        """The largest size that is in time when an image takes as long as it has pixels.

        A part of that time is fixed: a larger one takes less than that, a smaller one may take more.
        """
        w, h = self.size_px
        per_pixel_s = self._smooth_s / (w * h)
        in_time = (k for k, (w, h) in enumerate(SIZES_PX) if per_pixel_s * w * h <= budget_s)
        return next(in_time, len(SIZES_PX) - 1)

    def _choose(self, index: int) -> None:
        if index != self._index:
            self._index, self._drawn = index, 0


GONE = "no pictures: the drawing process has ended; P pauses, Escape keeps the drive and ends it"
"""What the driver reads when there will be no more images."""
_MOST_BYTES = 3 * max(width * height for width, height in SIZES_PX)
_NICE = 3
"""An image may come late, a tick may not."""
_END_S = 3.0


class RenderProcess(AbstractContextManager["RenderProcess"]):
    """A process that draws one image at a time; a context manager.

    It starts at once and loads what it needs while its parent still builds the town. It ends with its
    parent, however that ends: the pipe between them breaks then.
    """

    def __init__(self) -> None:
        context = get_context("spawn")
        # One image is asked for at a time, so nobody writes here while the other side reads.
        self._memory: Any = context.RawArray("B", _MOST_BYTES)
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_draw_images, args=(there, self._memory), daemon=True)
        self._process.start()
        there.close()
        self._busy = True
        self.alive = True
        """Whether images are still to come."""

    def prepare(self, stage: SensorStage) -> None:
        """Hand over town, weather and quality, of which the other process makes a renderer.

        Returns when they have been read there.
        """
        # A process that has ended is noticed by who waits for it.
        with suppress(OSError):
            self._pipe.send(stage)

    def wait_until_ready(self) -> None:
        """Wait until the scene stands.

        Raises:
            RenderError: there is no OpenGL, or the process ended.
        """
        try:
            answer = self._pipe.recv()
        except (EOFError, OSError):
            self.close()
            raise RenderError("the process that draws the window ended; its traceback stands above") from None
        if isinstance(answer, CarlaLocError):
            self.close()
            raise answer
        self._busy = False

    @property
    def idle(self) -> bool:
        """Whether an image can be ordered."""
        return self.alive and not self._busy

    def ask(self, snapshot: Snapshot, view: str, *, photo: bool = False) -> None:
        """Order an image, if the process is idle; a photo has the largest size, and comes by itself."""
        try:
            self._pipe.send((snapshot, view, photo))
            self._busy = True
        except OSError:
            self.alive = False

    def image(self, patience_s: float | None) -> NDArray[np.uint8] | None:
        """The image last ordered, sRGB (H, W, 3), when it is finished; waits so long for it, or until then.

        It is a view of shared memory and good until the next one is ordered.
        """
        if not (self._busy and self.alive):
            return None
        try:
            if not self._pipe.poll(patience_s):
                return None
            width, height = self._pipe.recv()
        except (EOFError, OSError):
            self.alive = False
            return None
        self._busy = False
        whole = np.frombuffer(self._memory, np.uint8)
        return whole[: 3 * width * height].reshape(height, width, 3)

    def close(self) -> None:
        """End the process; may be called twice."""
        self.alive = False
        self._pipe.close()
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def __exit__(self, *_: object) -> None:
        self.close()


def _draw_images(pipe: Connection, memory: Any) -> None:
    """Draw what is ordered until the pipe breaks."""
    # Ctrl-C is the parent's to answer: it ends the drive, closes the file and then the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError):
        os.nice(_NICE)
    try:
        stage: SensorStage = pipe.recv()
        stage.renderer()
    except (EOFError, OSError):
        return
    except CarlaLocError as error:
        pipe.send(error)
        return
    view, whole = LiveView(stage), np.frombuffer(memory, np.uint8)

    def hand_over(image: NDArray[np.uint8]) -> None:
        whole[: image.size] = image.reshape(-1)
        pipe.send(image.shape[1::-1])

    with suppress(EOFError, OSError):
        pipe.send("ready")
        while True:
            order: tuple[Snapshot, str, bool] = pipe.recv()
            snapshot, name, photo = order
            (view.photo if photo else view.image)(snapshot, name, hand_over)


_CHASE_TURN = 0.06
_FOV_DEG = {"seat": 80.0, "chase": 75.0, "above": 60.0}


class LiveView:
    """Draws what the driver sees, in low resolution and at the renderer's lowest tier.

    Images become smaller where the machine would not draw twenty a second.

    Args:
        stage: Town, weather and renderer.
    """

    def __init__(self, stage: SensorStage) -> None:
        self._stage = stage
        self._resolution = LiveResolution()
        self._heading_rad: float | None = None
        self._last: GBuffer | None = None
        self._known: GBuffer | None = None
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
        earlier = self._known if view == self._view else None
        draw = renderer.begin_drawing(*seen, earlier=earlier)
        is_first = self._unfinished is None
        if self._unfinished is not None:
            hand_over(np.ascontiguousarray(self._unfinished()))
        # The next image hides surfaces by a finished one, which costs no waiting.
        self._known = self._last if view == self._view else None
        if self._known is not None:
            self._known.samples()
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
        known = heading if self._heading_rad is None else self._heading_rad
        known += math.remainder(heading - known, 2.0 * math.pi) * (1.0 if view == "above" else _CHASE_TURN)
        self._heading_rad = known
        turn = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.0, known)), T_world_base[:3, 3])
        if view == "chase":
            return turn @ _placed((-5.5, 0.0, 2.9), pitch_rad=0.14)
        return turn @ _placed((6.0, 0.0, 32.0), pitch_rad=math.pi / 2)


def _placed(position_m: tuple[float, float, float], *, pitch_rad: float) -> Array:
    """Pose of an optical frame in an FLU frame, nose down positive."""
    return from_rotation(quat_to_matrix(rpy_to_quat(0.0, pitch_rad, 0.0)) @ R_FLU_OPTICAL, position_m)
