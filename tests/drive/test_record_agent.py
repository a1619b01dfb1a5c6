"""Drives of agents: the environment's motion to the bit, and all that a replay or another drive needs."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from shared_fixtures.drives.driven_again import assert_same_again

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ConfigError, EpisodeError, OutputError
from carlaloc_env.envs.any_town_env import AnyTownEnv
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoTick
from recorder.cli.main import main
from recorder.devices.policy import PolicyDriver
from recorder.drive.episode_listener import EpisodeListener
from recorder.drive.record import RecordConfig, record
from recorder.drive.record_agent import RecordDrive
from recorder.episode.edit import write_episode
from recorder.episode.episode import Episode
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter
from recorder.episode_env.replay_env import ReplayEnv

VILLAGE = Path(__file__).parents[1] / "data" / "village.xodr"
TRAFFIC = "dynamic,vehicles=6,walkers=2"
GO = np.array([0.02, 0.5], np.float32)
POLICY = """
import numpy as np
RIG, ACTION = "state", "continuous"
def act(observation):
    return np.array([-0.3 * observation[5], 0.4 - observation[0]], np.float32)
"""


def _drive(env: gymnasium.Env[Any, Any], steps: int, seed: int = 5) -> list[tuple[Any, ...]]:
    """Steps of random actions that are the same in every environment."""
    env.action_space.seed(1)
    taken: list[tuple[Any, ...]] = [(*env.reset(seed=seed), None)]
    for _ in range(steps):
        action = env.action_space.sample()
        taken.append((*env.step(action), action))
        if taken[-1][2] or taken[-1][3]:
            break
    return taken


@pytest.mark.parametrize(
    ("action", "route", "skip"),
    [
        ("continuous", "random", 1),
        ("discrete", "town", 3),
        ("ackermann", "random", 2),
        ("controls", "town", 1),
    ],
)
def test_a_recorded_drive_is_the_environments_to_the_bit(
    tmp_path: Path, action: str, route: str, skip: int
) -> None:
    """Motion and others against an environment without a recorder; rewards and views against the replay."""
    settings: dict[str, Any] = {
        "map": VILLAGE, "rig": "state", "traffic": TRAFFIC, "route": route, "start": "anywhere",
        "action": action, "frame_skip": skip, "task": {"lane_offset_per_m_s": 2.0},
    }  # fmt: skip
    plain, recorded = CarlaLocEnv(**settings), RecordDrive(CarlaLocEnv(**settings), tmp_path / "agent.mcap")
    expected, taken = _drive(plain, 24), _drive(recorded, 24)
    recorded.close()
    for (one, *_), (other, *_) in zip(expected, taken, strict=True):
        np.testing.assert_array_equal(one, other)
    seed = taken[0][1]["drive_seed"]
    path = tmp_path / f"agent-{seed}-0.mcap"
    drive = Episode.load(path)
    assert drive.ego["position_m"].tobytes() == plain.world.timeline.ego.position_m.tobytes()
    assert drive.ego["quat_xyzw"].tobytes() == plain.world.timeline.ego.quat_xyzw.tobytes()
    assert len(drive.timeline()._frames) == len(plain.world.timeline._frames)
    for one, other in zip(drive.timeline()._frames, plain.world.timeline._frames, strict=True):
        assert one.position_m.tobytes() == other.position_m.tobytes()
    plain.close()
    assert (drive.header.seed, drive.header.action, drive.header.device) == (seed, action, "agent")
    assert drive.header.task["lane_offset_per_m_s"] == 2.0
    assert drive.header.route["length_m"] == taken[0][1]["route_length_m"]
    assert_same_again(path, VILLAGE)
    again = ReplayEnv(path, rig="state", map=VILLAGE, frame_skip=skip)
    np.testing.assert_allclose(again.reset()[0], taken[0][0], atol=1e-6)
    for seen, reward, ended, _, info, did in taken[1:]:
        view, other, over, _, told = again.step(None)
        np.testing.assert_allclose(view, seen, atol=1e-6)
        assert other == pytest.approx(reward, abs=1e-9)
        assert over == ended
        assert told["route_s_m"] == info["route_s_m"]
        if action in ("continuous", "controls"):
            np.testing.assert_allclose(told["action"], np.where(np.arange(len(did)) < 3, did, did > 0.5))
    again.close()


def test_a_drive_whose_route_is_not_known_is_refused(tmp_path: Path) -> None:
    """Before, its rewards were those of the town's own route, in silence."""
    env = RecordDrive(CarlaLocEnv(VILLAGE, "state", traffic="empty", route="random"), tmp_path / "a.mcap")
    _drive(env, 4)
    env.close()
    (path,) = tmp_path.glob("a-*.mcap")
    drive = Episode.load(path)
    texts = drive.header.to_metadata()
    route = {name: value for name, value in drive.header.route.items() if name not in ("points_m", "start")}
    header = EpisodeHeader(
        **{name: getattr(drive.header, name) for name in EpisodeHeader.__slots__ if name != "route"},
        route=route,
    )
    assert texts != header.to_metadata()
    frames = drive.timeline()._frames
    signals = np.ascontiguousarray(drive.steps["signals"])
    old = write_episode(tmp_path / "old.mcap", header, drive.ego, frames, signals, (), overwrite=False)
    with pytest.raises(EpisodeError, match="record the drive anew"):
        ReplayEnv(old.path, rig="state", map=VILLAGE)


def test_record_with_the_seed_of_a_drive_gives_its_traffic(tmp_path: Path) -> None:
    """The same controls on that seed: every byte of ego, others and lights."""
    env = RecordDrive(CarlaLocEnv(VILLAGE, "state", traffic=TRAFFIC), tmp_path / "a.mcap")
    _, info = env.reset(seed=5)
    for _ in range(40):
        env.step(GO)
    env.close()
    pedal = float(GO[1])

    class Driver:
        name, close = "test", staticmethod(lambda: None)

        def read(self, view: object) -> Controls:
            return Controls(steer=float(GO[0]), throttle=pedal)

    again = RecordConfig(
        map=str(VILLAGE),
        out=tmp_path / "b.mcap",
        duration_s=2.0,
        seed=info["drive_seed"],
        traffic=TRAFFIC,
    )
    record(again, device=Driver())
    ours = Episode.load(tmp_path / f"a-{info['drive_seed']}-0.mcap")
    theirs = Episode.load(again.out)
    assert ours.ego.tobytes() == theirs.ego.tobytes()
    assert ours.steps.tobytes() == theirs.steps.tobytes()


def test_a_policy_at_the_wheel_drives_as_in_an_environment(tmp_path: Path) -> None:
    """`record --device policy.py` against `RecordDrive` on the same seed; and a route and a start."""
    policy = tmp_path / "policy.py"
    policy.write_text(POLICY)
    env = RecordDrive(CarlaLocEnv(VILLAGE, "state", traffic=TRAFFIC, start=0.25), tmp_path / "a.mcap")
    act = PolicyDriver(policy)._act
    seen, info = env.reset(seed=2)
    for _ in range(30):
        seen, *_ = env.step(act(seen))
    env.close()
    out, seed = tmp_path / "b.mcap", str(info["drive_seed"])
    words = ["--map", str(VILLAGE), "--device", str(policy), "--duration", "1.5", "--start", "0.25"]
    assert main(["record", *words, "--traffic", TRAFFIC, "--seed", seed, "--out", str(out)]) == 0
    ours, theirs = Episode.load(tmp_path / f"a-{seed}-0.mcap"), Episode.load(out)
    assert ours.ego.tobytes() == theirs.ego.tobytes()
    assert (theirs.header.device, theirs.header.action) == ("policy.py", "continuous")
    assert theirs.header.route["start"] == 0.25


@pytest.mark.parametrize(
    ("text", "why", "left"),
    [
        ("RIG, ACTION = 'state', 'continuous'", "defines no act", []),
        ("import nothing_of_this_name", "does not run: ModuleNotFoundError", []),
        (POLICY.replace("[5]", "[5000]"), "act failed: IndexError", ["a.mcap.recording"]),
        (POLICY.replace("0.4 -", "9.0 -"), "act failed: ActionError: pedal is", ["a.mcap.recording"]),
    ],
)
def test_a_policy_that_fails_is_one_line_and_its_drive_is_kept(
    tmp_path: Path, text: str, why: str, left: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    policy, out = tmp_path / "policy.py", tmp_path / "drives" / "a.mcap"
    policy.write_text(text)
    out.parent.mkdir()
    words = ["--map", str(VILLAGE), "--traffic", "empty", "--device", str(policy), "--out", str(out)]
    assert main(["record", *words]) == 1
    error = capsys.readouterr().err
    assert why in error
    assert "Traceback" not in error
    assert ("make it whole with" in error) == bool(left)
    assert [path.name for path in out.parent.iterdir()] == left


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--device", "none.py"], "cannot read the policy"),
        (["--device", "scriptd"], "did you mean 'scripted'"),
        (["--route", "randm"], "did you mean 'random'"),
        (["--route", "1,2,3"], "give a point"),
        (["--start", "2"], "from 0 to below 1"),
    ],
)
def test_words_that_do_not_fit_are_one_line(
    straight_map: Path, tmp_path: Path, words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["record", "--map", str(straight_map), "--out", str(tmp_path / "a.mcap"), *words]) == 1
    assert why in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_routes_of_record_are_those_of_the_environment(tmp_path: Path) -> None:
    """Points on the command line, and the same in an environment; a random one is known to its file."""
    env = CarlaLocEnv(VILLAGE, "state", traffic="empty", route="random")
    env.reset(seed=3)
    points = [f"{x!r},{y!r}" for x, y in env.driven.points_m]
    length_m = env.driven.route.length_m
    env.close()
    usual = ["record", "--map", str(VILLAGE), "--duration", "1", "--traffic", "empty", "--out"]
    assert main([*usual, str(tmp_path / "a.mcap"), "--route", *points]) == 0
    assert Episode.load(tmp_path / "a.mcap").header.route["length_m"] == length_m
    assert main([*usual, str(tmp_path / "b.mcap"), "--route", "random", "--start", "anywhere"]) == 0
    assert_same_again(tmp_path / "b.mcap", VILLAGE)


def test_files_are_named_kept_and_completed(straight_map: Path, tmp_path: Path) -> None:
    """By seed and number, where the trigger says so; at the end of an episode, a reset or a close."""
    path = tmp_path / "agent.mcap"
    base = CarlaLocEnv(straight_map, "state", traffic="empty")
    env = RecordDrive(TimeLimit(base, max_episode_steps=3), path, lambda number: number != 1)
    seeds = []
    for number in range(4):
        _, info = env.reset(seed=number)
        seeds.append(info["drive_seed"])
        for _ in range((3, 3, 2, 0)[number]):
            info = env.step(GO)[-1]
        files = sorted(tmp_path.glob("*.mcap"))
        assert ("drive_file" in info) == (number == 0)
        assert len(files) == (1, 1, 1, 2)[number]
    env.step(GO)
    env.reset(seed=9)
    env.close()
    names = [f"agent-{seeds[number]}-{number}.mcap" for number in (0, 2, 3)]
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names)
    ends = [event for event in Episode.load(tmp_path / names[0]).events if event.kind == "end"]
    assert len(ends) == 1
    with pytest.raises(OutputError, match="exists"):
        RecordDrive(CarlaLocEnv(straight_map, "state", traffic="empty"), path).reset(seed=0)
    again = RecordDrive(CarlaLocEnv(straight_map, "state", traffic="empty"), path, overwrite=True)
    again.reset(seed=0)
    again.step(GO)
    again.close()
    assert len(Episode.load(tmp_path / names[0]).ego) == STEP_TICKS + 2
    with pytest.raises(ConfigError, match="that drives"):
        RecordDrive(gymnasium.make("CartPole-v1"), path)


def test_any_town_and_workers_of_a_vector(straight_map: Path, tmp_path: Path) -> None:
    """Each worker has a file of its own; towns, weathers and routes are those that were drawn."""
    drawn = AnyTownEnv(towns=(straight_map, VILLAGE), traffic=("empty",), rig="state")
    env = RecordDrive(drawn, tmp_path / "any.mcap")
    towns = set()
    for seed in range(5):
        _, info = env.reset(seed=seed)
        env.step(GO)
        towns.add(Path(info["town"]).stem)
    env.close()
    assert {Episode.load(path).header.map_name for path in tmp_path.glob("any-*")} == towns
    out = str(tmp_path / "v.mcap")
    envs = gymnasium.make_vec(
        "CarlaLoc-v0", 2, "async", map=straight_map, rig="state", traffic="empty",
        wrappers=[lambda env: RecordDrive(env, out)],
    )  # fmt: skip
    _, info = envs.reset(seed=1)
    for _ in range(3):
        envs.step(np.tile(GO, (2, 1)))
    envs.close()
    names = {f"v-{seed}-0.mcap" for seed in info["drive_seed"]}
    assert len(names) == 2
    assert {path.name for path in tmp_path.glob("v-*")} == names


def test_a_kill_leaves_a_file_that_is_made_whole(straight_map: Path, tmp_path: Path) -> None:
    """All but the last second of the drive; nothing of it waits for the agent to end."""
    program = """
import sys, numpy
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from recorder.drive.record_agent import RecordDrive
env = RecordDrive(CarlaLocEnv(sys.argv[1], "state", traffic="empty"), sys.argv[2])
env.reset(seed=1)
for _ in range(60):
    env.step(numpy.array([0.0, 0.4], numpy.float32))
print("driven", flush=True)
sys.stdin.read()
"""
    words = [sys.executable, "-c", program, str(straight_map), str(tmp_path / "a.mcap")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == b"driven"
        os.kill(process.pid, signal.SIGKILL)
    (left,) = tmp_path.iterdir()
    assert left.suffix == ".recording"
    assert main(["info", "--repair", str(left)]) == 0
    (whole,) = tmp_path.iterdir()
    assert 2.0 < Episode.load(whole).duration_s <= 3.0
    assert_same_again(whole, straight_map)


def test_a_touch_that_hits_harder_is_recorded(tmp_path: Path) -> None:
    """So that a referee sees the impulse in the step in which it acted."""
    out, header = tmp_path / "a.mcap", EpisodeHeader(map_name="Town03")
    listener = EpisodeListener(lambda _: EpisodeWriter(out, header))
    listener.on_start(header.catalog)
    state = EgoTick((0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3, 0.0, 0.0, [0.0] * 4)
    for tick, impulse_ns in enumerate((0.0, 100.0, 2000.0, 900.0, 1500.0)):
        listener.on_tick(tick, state, Controls())
        if impulse_ns:
            listener.on_contact(tick, Contact(actor_id=7, impulse_ns=impulse_ns, position_m=(0.0,) * 3))
    listener.writer.close()
    touches = [(event.tick, event.data["impulse_ns"]) for event in Episode.load(out).events]
    assert touches == [(1, 100.0), (2, 2000.0)]
    assert listener.counts["collision"] == 1
