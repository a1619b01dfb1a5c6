"""Compiled functions called without the look at their arguments' types with which every call begins.

Where arguments are named tuples of many arrays, that look takes longer than a short kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

R = TypeVar("R")


def same_types(function: Callable[..., R]) -> Callable[..., R]:
    """A compiled function for a caller whose arguments have the types of the first call at every call.

    Nothing checks that they have: arrays the same data types, axes, order and permission to write. So one
    object makes them all and keeps this function to itself. Arguments are given by position.
    """
    dispatcher: Any = function
    machine_code: Callable[..., R] | None = None

    def call(*arguments: Any) -> R:
        nonlocal machine_code
        if machine_code is None:
            machine_code = dispatcher.compile(tuple(map(numba.typeof, arguments)))
        return machine_code(*arguments)

    return call
