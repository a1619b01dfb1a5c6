"""The process that draws the window: the same pictures, and no process left behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.processes.lifecycles import runs
from shared_fixtures.worlds.maps import VILLAGE

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.errors import RenderError
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.render.lighting.model_lamps import Emitters
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.snapshot import Snapshot, is_blink
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import traffic_of_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.window.cockpit import present_of
from recorder.window.drive_status import DriveStatus
from recorder.window.live_resolution import FIRST_PX
from recorder.window.live_view import LiveView
from recorder.window.render_process import RenderProcess
from recorder.window.window import WINDOW_PX

pytest.importorskip("moderngl")
ALONE = """
import os, signal, sys
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.window.render_process import RenderProcess

if __name__ == "__main__":
    stage = SensorStage(load_town(sys.argv[1]), seed=0, weather=weather_by_name("ClearNoon"), quality="low")
    renderer = RenderProcess()
    renderer.prepare(stage)
    renderer.wait_until_ready()
    print(renderer._process.pid, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def night() -> SensorStage:
    return SensorStage(load_town(VILLAGE), seed=0, weather=weather_by_name("ClearNight"), quality="low")


@pytest.fixture(scope="module")
def world() -> Iterator[DrivingWorld]:
    town = load_town(VILLAGE)
    world = DrivingWorld(town, traffic_of_town(town, "0.2", 0))
    world.reset(0)
    yield world
    world.close()


def image_of(renderer: RenderProcess, snapshot: Snapshot) -> NDArray[np.uint8]:
    renderer.ask(snapshot, "seat")
    while (found := renderer.image(0.1)) is None:
        assert renderer.alive
    return found.copy()


def wait_for(done: Callable[[], bool]) -> None:
    while not done():
        time.sleep(0.05)


def test_pictures_of_the_other_process_and_its_end(world: DrivingWorld) -> None:
    """It draws the very bytes of a view in this process; headlamps light the road; a kill is noticed."""
    stage = night()
    try:
        renderer = RenderProcess()
        renderer.prepare(stage)
        renderer.wait_until_ready()
    except RenderError as no_opengl:
        pytest.skip(str(no_opengl))
    with renderer:
        snapshots = [present_of(world, DriveStatus(headlamps=on)) for on in (True, False)]
        # Every picture but the first comes with the next order.
        lit, _, dark = (image_of(renderer, snapshots[k]) for k in (0, 1, 1))
        here = LiveView(stage)
        own: list[NDArray[np.uint8]] = []
        here.image(snapshots[0], "seat", own.append)
        np.testing.assert_array_equal(lit, own[0])
        renderer.ask(snapshots[0], "seat", photo=True)
        photo = renderer.image(None)
        assert photo is not None
        assert photo.shape == (*WINDOW_PX[::-1], 3)
        smaller = cv2.resize(photo, FIRST_PX, interpolation=cv2.INTER_AREA)
        assert np.corrcoef(smaller.ravel(), lit.ravel())[0, 1] > 0.9, "it shows the same"
        enlarged = cv2.resize(lit, WINDOW_PX, interpolation=cv2.INTER_CUBIC)
        assert cv2.Laplacian(photo, cv2.CV_64F).std() > 1.3 * cv2.Laplacian(enlarged, cv2.CV_64F).std()
        road = np.s_[150:220, 160:320]
        assert lit[road].mean() > 1.25 * dark[road].mean(), "the low beams are seen on the road"
        assert renderer.idle
        os.kill(renderer._process.pid or 0, signal.SIGKILL)
        renderer.ask(snapshots[0], "seat")
        wait_for(lambda: renderer.image(0.01) is None and not renderer.alive)
        assert not renderer.idle
    stage.close()


def test_it_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "alone.py"
    script.write_text(ALONE)
    parent = subprocess.run([sys.executable, str(script), str(VILLAGE)], stdout=subprocess.PIPE, check=False)
    if not parent.stdout:
        pytest.skip("no OpenGL")
    child = int(parent.stdout)
    assert parent.returncode == -signal.SIGKILL
    wait_for(lambda: not runs(child))


def test_indicators_blink_on_the_ego_and_lamps_go_out(world: DrivingWorld) -> None:
    stage = night()
    names = stage.library.names
    status = DriveStatus(indicator="left", headlamps=True)
    shown = set()
    for _ in range(200):
        world.tick(status.controls)
        seen = instances_at(stage.library, stage.lenses, present_of(world, status))
        shown.add(("ego/left" in {names[m] for m in seen.model}, is_blink(world.now_ns)))
    assert shown == {(True, True), (False, False)}
    emitters = Emitters(stage.library)
    beams = []
    for on in (True, False):
        seen = instances_at(stage.library, stage.lenses, present_of(world, DriveStatus(headlamps=on)))
        beams.append(np.count_nonzero(emitters.lights(seen).beam))
    assert beams[0] == beams[1] + 1
