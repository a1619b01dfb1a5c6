"""Whether two things are the same to the last bit: records, groups and tables, whatever they hold."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def assert_same(a: Any, b: Any, where: str = "") -> None:
    """Fails where two things differ: in a type, a shape, or one bit of a value."""
    assert type(a) is type(b), where
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        assert a.shape == b.shape, where
        assert a.flags.writeable == b.flags.writeable, where
        names = a.dtype.names or (None,)
        for name in names:
            own, other = (a, b) if name is None else (a[name], b[name])
            assert own.tobytes() == other.tobytes(), f"{where}.{name}"
    elif is_dataclass(a):
        for field in fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, tuple | list):
        assert len(a) == len(b), where
        for number, (own, other) in enumerate(zip(a, b, strict=True)):
            assert_same(own, other, f"{where}[{number}]")
    else:
        assert repr(a) == repr(b), where
