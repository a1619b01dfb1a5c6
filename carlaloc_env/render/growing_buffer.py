"""A buffer of OpenGL that is rewritten for every drawing and grows with its content."""

from typing import Any

import moderngl


class GrowingBuffer:
    """Buffer that is at least as large as its last content.

    Vertex arrays name buffers, so a buffer that has become too small lives on until all are released; sizes
    double, so that all of those together are no larger than the last.
    """

    def __init__(self, context: moderngl.Context, size: int) -> None:
        """Reserve some bytes."""
        self._context = context
        self._all = [context.buffer(reserve=size, dynamic=True)]

    @property
    def buffer(self) -> moderngl.Buffer:
        """The buffer that holds the last content."""
        return self._all[-1]

    def write(self, data: Any) -> None:
        """Write an array or bytes from the beginning; what is being drawn keeps what stood there."""
        size = memoryview(data).nbytes
        if size > self.buffer.size:
            self._all.append(self._context.buffer(reserve=2 * size, dynamic=True))
        self.buffer.orphan()
        self.buffer.write(data)

    def release(self) -> None:
        """Free it."""
        for buffer in self._all:
            buffer.release()
