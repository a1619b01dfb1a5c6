"""What dataclasses have in common that hold arrays with a row for each of N things."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Arrays = TypeVar("Arrays", bound="ParallelArrays")


class ParallelArrays:
    """Base of dataclasses with slots all of whose fields are arrays of the same N rows."""

    __slots__: tuple[str, ...] = ()

    def take(self: Arrays, rows: NDArray[Any] | slice) -> Arrays:
        """Some of the rows, by index, mask or slice."""
        make: Any = type(self)
        taken: Arrays = make(**{name: getattr(self, name)[rows] for name in self.__slots__})
        return taken

    @classmethod
    def joined(cls: type[Arrays], parts: Sequence[Arrays]) -> Arrays:
        """All rows of several groups, at least one, in their order."""
        make: Any = cls
        whole: Arrays = make(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__}
        )
        return whole
