"""Driving by an estimated pose: the truth changes nothing, an offset moves the car, a dead system ends it."""

import csv
import runpy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task.state_vector import state_names
from carlaloc_env.rigs.rig import SensorRig
from recorder.cli.main import main
from recorder.laboratory.estimated_pose_env import ENDED_BY, EstimatedPoseEnv
from recorder.laboratory.pose_source import KnownError, SystemPose
from recorder.laboratory.step_driver import StepDriver

SENSORS = "sensors:\n- {kind: lidar, columns: 40, outputs: [cloud]}\n- {kind: imu}\n"
RIG = SensorRig.from_yaml("name: few\n" + SENSORS)
OWN = """
import os, time
import numpy as np
from recorder.slam.system import END, System
SYSTEM = System(
    name="own", title="Own", what="a test", needs=("lidar", "imu"), runner="x:run", frame="lidar", instant=END
)
def run(sequence, clock):
    T = np.eye(4)
    for number, scan in enumerate(sequence.scans()):
        inertial = sequence.imu_until(scan.stamp_ns + 50_000_000)
        assert len(inertial) == (11 if number == 0 else 10), len(inertial)
        {body}
        yield scan.stamp_ns, T
"""


@pytest.fixture
def make(straight_map: Path) -> Iterator[Callable[..., CarlaLocEnv]]:
    """Environments on a straight road without others, closed at the end."""
    made: list[CarlaLocEnv] = []

    def new(rig: Any = "state", **options: Any) -> CarlaLocEnv:
        settings: dict[str, Any] = {"action": "controls", "traffic": "empty", **options}
        made.append(CarlaLocEnv(straight_map, rig, **settings))
        return made[-1]

    yield new
    for env in made:
        env.close()


def system(folder: Path, body: str) -> str:
    """A system's file."""
    (folder / "own.py").write_text(OWN.format(body=body))
    return str(folder / "own.py")


def test_by_the_truth_the_episode_is_that_of_the_plain_environment(make: Callable[..., CarlaLocEnv]) -> None:
    """Bit by bit, with others on the road: observations, rewards and the driver's own actions."""
    traffic = "dynamic,vehicles=4,walkers=0"
    plain, wrapped = (
        make(traffic=traffic),
        EstimatedPoseEnv(make(traffic=traffic), KnownError(), observe="state"),
    )
    drivers = StepDriver(3), StepDriver(3)
    seen, believed = plain.reset(seed=3)[0], wrapped.reset(seed=3)[0]
    for _ in range(110):
        actions = drivers[0].act(plain.world.driver_view()), drivers[1].act(wrapped.world.driver_view())
        assert np.array_equal(seen, believed)
        assert np.array_equal(*actions)
        seen, reward, *ends, info = plain.step(actions[0])
        believed, other, *others, told = wrapped.step(actions[1])
        assert (reward, ends, info["route_offset_m"]) == (other, others, told["route_offset_m"])
    assert info["route_s_m"] > 2.0
    assert told["pose_error_m"] == 0.0


def test_a_constant_offset_moves_the_driven_line_by_as_much(make: Callable[..., CarlaLocEnv]) -> None:
    """A linear law settles at one believed offset, that of the road's crossfall, wherever the pose is."""
    settled = {}
    for offset_m in (0.0, 0.3):
        env = EstimatedPoseEnv(make(), KnownError(offset_m), observe="state")
        env.reset(seed=0)
        for _ in range(300):
            view = env.world.driver_view()
            heading = np.sin(view.heading_rad - view.route.at(view.route_s_m).heading_rad[0])
            throttle = 0.5 * (view.speed_mps < 6.0)
            observation, *_, info = env.step([-0.1 * view.offset_m - heading, throttle, 0.0, 0.0, 0.0])
        assert info["pose_error_m"] == pytest.approx(abs(offset_m), abs=1e-9)
        settled[offset_m] = info["route_offset_m"]
        # The observation is believed, too: in 5 m, the car takes itself to be where the truth put it.
        believed_m = 5.0 * observation[state_names().index("lateral_offset")]
        assert believed_m == pytest.approx(settled[0.0], abs=0.005)
    assert settled[0.3] - settled[0.0] == pytest.approx(-0.3, abs=0.005)


def test_a_systems_file_is_believed(make: Callable[..., CarlaLocEnv], tmp_path: Path) -> None:
    """It claims that the car moves to the left by 2 cm a sweep, while the car stands and then afterwards."""
    source = SystemPose(system(tmp_path, "T[1, 3] += 0.02 * (number >= 60)"))
    env = EstimatedPoseEnv(make(RIG, info=("samples",)), source)
    _, info = env.reset(seed=0)
    for _ in range(62):
        _, _, terminated, truncated, info = env.step([0.0, 0.6, 0.0, 0.0, 0.0])
        assert not terminated
        assert not truncated
    # It never saw the car move: all of the way is its error, and 2 cm to the left for two sweeps.
    way_m = info["route_s_m"]
    T_error = np.linalg.inv(env.world.T_true) @ info["believed_pose"]
    assert way_m > 3.0
    assert T_error[0, 3] == pytest.approx(-way_m, rel=0.05)
    assert T_error[1, 3] == pytest.approx(0.04, abs=0.01)
    env.close()


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("if number == 5: raise ValueError('lost it')", "lost it"),
        ("if number == 5: os.kill(os.getpid(), 9)", "has ended"),
        ("if number == 5: T = T * np.nan", "not finite"),
        ("if number == 5: time.sleep(60)", "no answer for 3 s"),
        ("if number > 5: continue", "no pose for 0.5 s"),
    ],
)
def test_a_dead_estimator_ends_the_episode_with_a_reason(
    make: Callable[..., CarlaLocEnv], tmp_path: Path, body: str, reason: str
) -> None:
    source = SystemPose(system(tmp_path, body), silence_s=0.5, log=tmp_path)
    env = EstimatedPoseEnv(make(RIG, info=("samples",)), source)
    env.reset(seed=0)
    truncated, steps, info = False, 0, {}
    while not truncated and steps < 20:
        _, _, _, truncated, info = env.step([0.0, 0.0, 1.0, 0.0, 0.0])
        steps += 1
        if steps == 4 and "sleep" in body:
            # It has begun, which may take long beside others, and answers each scan from here on.
            assert source._live is not None
            source._live._patience_s = 3.0
    assert truncated
    assert steps >= 6
    assert info["ended_by"] == ENDED_BY
    assert reason in info["estimator_error"]
    env.close()


def test_systems_that_cannot_drive_are_refused(make: Callable[..., CarlaLocEnv], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="info="):
        EstimatedPoseEnv(make(RIG, info=()), SystemPose("small_gicp")).reset()
    file = Path(system(tmp_path, "pass"))
    file.write_text(file.read_text().replace("yield scan.stamp_ns, T", "pass\n    return []"))
    env = EstimatedPoseEnv(make(RIG, info=("samples",)), SystemPose(str(file)))
    env.reset(seed=0)
    infos = [env.step([0.0, 0.0, 1.0, 0.0, 0.0])[-1] for _ in range(3)]
    assert "yield each pose" in infos[-1]["estimator_error"]
    env.close()


def test_the_command_scores_drives(
    straight_map: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """APE after a fit is blind to a constant offset, by which the car leaves its lane."""
    words = ["closedloop", str(straight_map), "--offset", "1.2", "--traffic", "empty", "--limit", "9"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    assert "ended by time" in capsys.readouterr().out
    with (tmp_path / "closed_loop.csv").open() as file:
        truth, shifted = csv.DictReader(file)
    assert (truth["source"], shifted["source"]) == ("truth", "+1.2 m")
    assert float(truth["pose_error_rms_m"]) == 0.0
    assert float(shifted["pose_error_rms_m"]) == pytest.approx(1.2)
    assert float(shifted["ape_m"]) < 0.1
    assert int(truth["lane_invasions"]) == 0
    assert int(shifted["lane_invasions"]) >= 1
    assert main([*words, "--out", str(tmp_path)]) == 1
    assert "--force" in capsys.readouterr().err


def test_the_example_drives_by_its_policy(straight_map: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(
        str(Path(__file__).parents[2] / "examples" / "robustness" / "18_drive_by_slam.py")
    )
    info = example["main"](straight_map, KnownError(-0.4), rig="state", seconds=4.0)
    assert info["route_s_m"] > 3.0
    assert "pose 0.40 m off" in capsys.readouterr().out
