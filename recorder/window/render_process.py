"""Draws images in a process of their own, so that drawing and driving share no processor core."""

import os
import signal
from contextlib import AbstractContextManager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import CarlaLocError, RenderError
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.snapshot import Snapshot
from recorder.window.live_resolution import SIZES_PX
from recorder.window.live_view import LiveView

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
