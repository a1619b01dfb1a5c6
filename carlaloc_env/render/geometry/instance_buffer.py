"""Poses, colours and ids of movable models on the graphics side."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.growing_buffer import GrowingBuffer
from carlaloc_env.scene.mesh import Instances

INSTANCE = np.dtype([("rows", "<f4", (3, 4)), ("tint", "u1", 4), ("id", "<u4")])
"""One packed instance, 56 bytes: the top three rows of its pose, its colour, its instance id."""


class InstanceBuffer:
    """Instances sorted by model in a buffer, with each model's range; rewritten for every drawing."""

    def __init__(self, context: moderngl.Context, models: int) -> None:
        self._rows = GrowingBuffer(context, 256 * INSTANCE.itemsize)
        self.number = np.zeros(models, dtype=np.int64)
        """Instances of each model, shape (M,)."""
        self.begin = np.zeros(models, dtype=np.int64)
        """First row of each model, shape (M,)."""
        self.model = np.zeros(0, dtype=np.int32)
        """Model of each row, shape (N,)."""
        self.rows = np.zeros((0, 3, 4), dtype=np.float32)
        """Pose of each row, shape (N, 3, 4)."""

    @property
    def buffer(self) -> moderngl.Buffer:
        """The instances as shaders read them."""
        return self._rows.buffer

    @property
    def used(self) -> NDArray[np.intp]:
        """Models that have instances."""
        return np.flatnonzero(self.number)

    def fill(self, instances: Instances, which: NDArray[np.intp]) -> None:
        """Hold some of the instances."""
        order = which[np.argsort(instances.model[which], kind="stable")]
        self.number = np.bincount(instances.model[order], minlength=len(self.number))
        self.begin = np.cumsum(self.number) - self.number
        self.model = instances.model[order]
        self.rows = np.ascontiguousarray(instances.T_world_model[order, :3, :], dtype=np.float32)
        out = np.zeros(max(len(order), 1), dtype=INSTANCE)
        out["rows"][: len(order)] = self.rows
        out["tint"][: len(order), :3] = instances.tint[order]
        out["id"][: len(order)] = instances.instance[order]
        self._rows.write(out.tobytes())

    def release(self) -> None:
        """Free the buffer."""
        self._rows.release()
