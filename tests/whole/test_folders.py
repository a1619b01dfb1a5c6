"""No folder of the repository holds more than a person can take in at once."""

import subprocess
from collections import Counter
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).parents[2]
MOST = 18


def test_folders_have_few_files() -> None:
    """Files that git knows, or would take; those of folders below are not counted."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout of git, so files that were made here cannot be told from its own")
    command = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    paths = [path for path in map(PurePosixPath, listed.splitlines()) if (ROOT / path).is_file()]
    counts = Counter(str(path.parent) for path in paths)
    assert len(paths) > 500
    assert {folder: count for folder, count in counts.items() if count > MOST} == {}
