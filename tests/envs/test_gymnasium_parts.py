"""What agents' programs put round an environment: wrappers, films, workers that die, interrupts."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import (
    FlattenObservation,
    FrameStackObservation,
    NormalizeReward,
    RecordVideo,
    TimeLimit,
)
from shared_fixtures.drives.straight_drives import MakeEnv
from shared_fixtures.processes.lifecycles import runs
from shared_fixtures.worlds.render_scenes import need_opengl

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.core.errors import RenderError
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv

GO = np.array([0.0, 0.4], np.float32)
FILM_STEPS = 6
TWO_WORKERS = """
import os, sys, time
import gymnasium, numpy, carlaloc_env
if __name__ == "__main__":
    envs = gymnasium.make_vec(
        "CarlaLoc-v0", 2, "async", map=sys.argv[1], rig="state", traffic="empty"
    )
    envs.reset(seed=1)
    print(*[process.pid for process in envs.processes], flush=True)
    while True:
        envs.step(numpy.zeros((2, 2), numpy.float32))
"""


@pytest.fixture
def env(make_env: MakeEnv) -> CarlaLocEnv:
    return make_env(rig="bev")


def _shown(straight_map: Path, mode: str, **settings: Any) -> CarlaLocEnv:
    return CarlaLocEnv(straight_map, "state", traffic="empty", render_mode=mode, quality="low", **settings)


def test_wrappers_of_gymnasium_fit(env: CarlaLocEnv) -> None:
    """One in another; the innermost truncates, the flat vector is the parts one after the other."""
    flat = FlattenObservation(TimeLimit(env, max_episode_steps=3))
    wrapped = NormalizeReward(FrameStackObservation(flat, stack_size=2))
    wrapped.reset(seed=1)
    told = [wrapped.step(GO) for _ in range(3)]
    assert [step[3] for step in told] == [False, False, True]
    newest = np.concatenate([env._view.observe(env.world, 0.0)["bev"].ravel().astype(np.float32)])
    assert told[-1][0].shape[0] == 2
    np.testing.assert_array_equal(told[-1][0][1][: len(newest)], newest)


@pytest.mark.parametrize("skip", [1, 4])
def test_films_have_a_picture_a_step_and_last_as_long_as_the_drive(
    skip: int, straight_map: Path, tmp_path: Path
) -> None:
    import cv2

    need_opengl()
    pytest.importorskip("moviepy", reason="RecordVideo of Gymnasium needs moviepy")
    env = RecordVideo(
        _shown(straight_map, "rgb_array", frame_skip=skip), str(tmp_path), episode_trigger=lambda _: True
    )
    env.reset(seed=1)
    for _ in range(FILM_STEPS):
        env.step(GO)
    env.close()
    (path,) = tmp_path.glob("*.mp4")
    film = cv2.VideoCapture(str(path))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == pytest.approx(FILM_STEPS + 1, abs=1)
    assert film.get(cv2.CAP_PROP_FPS) == 20.0 / skip
    assert (film.get(cv2.CAP_PROP_FRAME_WIDTH), film.get(cv2.CAP_PROP_FRAME_HEIGHT)) == (640, 360)


def test_a_window_without_a_display_is_refused_in_one_line(
    straight_map: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    env = _shown(straight_map, "human")
    with pytest.raises(RenderError, match="needs a display; set DISPLAY, or use 'rgb_array'"):
        env.reset(seed=1)
    env.close()


def test_a_window_shows_every_step(straight_map: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a display of SDL's own, in memory."""
    need_opengl()
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    env = _shown(straight_map, "human")
    env.reset(seed=1)
    env.step(GO)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    assert shown.shape == (640, 360, 3)
    assert shown.std() > 10.0
    assert env.render() is None
    env.close()


def test_a_worker_that_dies_raises_in_the_parent(straight_map: Path) -> None:
    envs = gymnasium.make_vec("CarlaLoc-v0", 2, "async", map=str(straight_map), rig="state", traffic="empty")
    envs.reset(seed=1)
    processes = envs.processes  # type: ignore[attr-defined]
    os.kill(processes[1].pid, signal.SIGKILL)
    processes[1].join()
    with pytest.raises((EOFError, ConnectionResetError, BrokenPipeError)):
        envs.step(np.zeros((2, 2), np.float32))
    for process in processes:
        process.kill()


def test_an_interrupt_leaves_no_orphan(straight_map: Path, tmp_path: Path) -> None:
    program = tmp_path / "two.py"
    program.write_text(TWO_WORKERS)
    child = subprocess.Popen(
        [sys.executable, str(program), str(straight_map)],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True,
    )  # fmt: skip
    assert child.stdout is not None
    workers = [int(word) for word in child.stdout.readline().split()]
    assert len(workers) == 2
    os.killpg(child.pid, signal.SIGINT)
    child.wait(600)
    end = time.monotonic() + 600.0
    while alive := [pid for pid in workers if runs(pid)]:
        assert time.monotonic() < end, f"still there: {alive}"
        time.sleep(0.1)
