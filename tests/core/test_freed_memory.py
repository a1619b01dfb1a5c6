"""Memory that was freed goes back to the system."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.freed_memory import give_back_mapped_pages

SCRIPT = """
import numpy as np
from carlaloc_env.core.freed_memory import give_back_freed_memory

def resident_kb():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))

many = [np.ones(8000) for _ in range(4000)]
keep = many[::400]
full = resident_kb()
del many
give_back_freed_memory()
print(full, resident_kb())
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="this system does not tell it")
def test_pages_between_what_is_kept_are_given_back() -> None:
    """4000 arrays of 64 kB, of which 10 stay: at least four fifths of the 256 MB leave the process."""
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    full_kb, after_kb = map(int, done.stdout.split())
    assert full_kb - after_kb > 0.8 * 256_000


MAPPED = """
import sys
import numpy as np
from carlaloc_env.core.files.array_files import load, save
from carlaloc_env.core.freed_memory import give_back_mapped_pages
from pathlib import Path

def resident_kb():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssFile"))

path = Path(sys.argv[1])
save(path, {"numbers": np.arange(8_000_000)})
loaded = load(path)["numbers"]
before = resident_kb()
total = int(loaded.sum())
read = resident_kb()
give_back_mapped_pages(loaded[5:100].reshape(5, 19))
print(before, read, resident_kb(), total == int(loaded.sum()))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="this system does not tell it")
def test_pages_of_a_cached_file_stay_no_longer_than_they_are_needed(tmp_path: Path) -> None:
    """Of 64 MB little is held after loading, all when it has been read, little after; its values stay."""
    command = [sys.executable, "-c", MAPPED, str(tmp_path / "numbers.arrays")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded_kb, read_kb, after_kb, same = done.stdout.split()
    assert int(read_kb) - int(loaded_kb) > 0.9 * 62_500
    assert int(read_kb) - int(after_kb) > 0.9 * 62_500
    assert same == "True"


def test_arrays_of_no_file_are_left_alone() -> None:
    """An array in memory keeps its values."""
    numbers = np.arange(10)
    give_back_mapped_pages(numbers)
    assert numbers.tolist() == list(range(10))
