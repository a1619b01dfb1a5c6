"""Large arrays that processes share lie in one file, which nobody can write to and which has all of them."""

import mmap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES, in_shared_memory


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def shared(arrays: Arrays) -> Arrays:
    return in_shared_memory(arrays, "numbers", "test", module="carlaloc_env.core.clock", kept_files=2)


def is_mapped(array: Any) -> bool:
    while array is not None and not isinstance(array, mmap.mmap):
        array = getattr(array, "base", None)
    return array is not None


def test_the_second_process_maps_what_the_first_has_written(folder: Path) -> None:
    numbers = {"corners": np.arange(SHARED_FROM_BYTES // 4, dtype=np.uint32), "tag": np.ones(3, np.uint8)}
    assert not is_mapped(shared(numbers)["corners"])
    found = shared({name: value.copy() for name, value in numbers.items()})
    assert all(is_mapped(value) for value in found.values())
    for name, value in numbers.items():
        np.testing.assert_array_equal(found[name], value)
        with pytest.raises(ValueError, match="read-only"):
            found[name][0] = 1
    numbers["tag"][0] = 2  # What they were made of can still be written to.
    assert shared(numbers)["tag"][0] == 2
    assert len(list(folder.glob("*.test"))) == 2


def test_small_arrays_have_memory_of_their_own(folder: Path) -> None:
    found = shared({"tag": np.ones(3, np.uint8)})
    assert not found["tag"].flags.writeable
    assert not folder.exists()
