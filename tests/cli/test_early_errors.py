"""A replay's mistakes are told before anything that takes long is imported."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = (
    "scipy.signal", "scipy.spatial", "scipy.optimize", "cv2", "open3d", "moderngl", "h5py", "rosbags",
    "pybullet", "shapely", "matplotlib", "lxml",
)  # fmt: skip
"""Libraries of those that cast, draw, build and write; numba and gymnasium are the packages' own."""
CODE = """
import json, resource, sys
from recorder.cli.main import main
code = main(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_SELF)
heavy = [name for name in %r if name in sys.modules]
print(json.dumps([code, heavy, used.ru_utime + used.ru_stime]))
"""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--rig papr", "did you mean 'paper'"),
        ("--weather Sunny", "Sunny"),
        ("--traffic statik", "did you mean 'static'"),
        ("--format rosbag3", "did you mean 'rosbag"),
        ("--topics standrad", "did you mean 'standard'"),
        ("--quality ultra --rig state", "ultra"),
        ("--start 500 --rig state", "drive ends at"),
        ("--camera-start 99 --rig state", "--camera-start"),
        ("--start 3 --camera-start 0 --camera-duration 1", "--camera-start"),
        ("--seed -1", "seed"),
        ("--map Town05", "driven in Town03, not in Town05"),
        ("--fault lidar.drop_share=0.1 --rig state", "sensor with faults in this rig"),
    ],
)
def test_mistakes_are_told_early(words: str, message: str, short_drive: Path, tmp_path: Path) -> None:
    """Counted in processor time, so that other work on the machine does not matter."""
    out = tmp_path / "out"
    given = ["replay", str(short_drive), *words.split(), "--out", str(out)]
    command = [sys.executable, "-c", CODE % (HEAVY,), *given]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, heavy, seconds = json.loads(done.stdout.splitlines()[-1])
    assert code in (1, 2)
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("carlaloc")]
    assert message in line
    assert heavy == []
    assert seconds < 2.0
    assert not out.exists()


def test_info_loads_no_compiler(short_drive: Path) -> None:
    """The summary of a drive comes without numba, which takes as long to import as all else together."""
    code = (
        "import sys; sys.modules['numba'] = None; from recorder.cli.main import main;"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "info", str(short_drive)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "complete" in done.stdout


def test_a_town_from_the_cache_loads_nothing_that_builds_towns() -> None:
    """`gymnasium.make` of a town that is kept on disk, whose file has the numbers of its traffic."""
    code = (
        "import gymnasium, carlaloc_env, sys; gymnasium.make('CarlaLoc-Town03-v0', rig='state');"
        "sys.exit('carlaloc_env.scenery.construction' in sys.modules)"
    )
    # The first one may have to build the town.
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, check=False) for _ in range(2)]
    assert runs[-1].returncode == 0, runs[-1].stderr
