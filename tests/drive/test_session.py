"""Drives in real time: pace, rules, restarts, and driving recorded controls again."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.controls import Controls
from carlaloc_env.core.errors import ConfigError, EpisodeError
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.signals import SignalState
from carlaloc_env.traffic.world import traffic_of_town
from recorder.drive.real_time_pacer import MOST_TICKS, Pacer
from recorder.drive.record import RecordConfig, record
from recorder.drive.resimulate import resimulate
from recorder.drive.traffic_rules import RuleMonitor
from recorder.episode.episode import EgoRow, Episode, EpisodeWriter, open_episode


class Clock:
    """Time that the test sets."""

    def __init__(self) -> None:
        self.now_s = 5.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture(scope="module")
def town() -> Town:
    return load_town("Town03")


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drive") / "short.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=6.0, seed=3, traffic="0.4"))
    return out


def test_pace_is_exact_on_a_fast_machine() -> None:
    clock = Clock()
    pacer, ticks = Pacer(clock), 0
    for _ in range(1000):
        clock.now_s += 0.0167
        ticks += pacer.due()
    assert ticks == pytest.approx(16.7 * 200, abs=2)
    assert pacer.speed == pytest.approx(1.0, abs=0.01)
    assert not pacer.is_slow


def test_slow_machine_slows_the_world_evenly() -> None:
    """Pictures of 100 ms hold ten ticks each: half speed, no bursts, no debt afterwards."""
    clock = Clock()
    pacer, batches = Pacer(clock), []
    for _ in range(100):
        clock.now_s += 0.1
        batches.append(pacer.due())
    assert set(batches) == {MOST_TICKS}
    assert pacer.is_slow
    assert pacer.speed == pytest.approx(0.5, abs=0.01)
    clock.now_s += 0.01
    assert pacer.due() <= 3


def test_pause_owes_no_time() -> None:
    clock = Clock()
    pacer = Pacer(clock)
    clock.now_s += 60.0
    pacer.restart()
    assert pacer.due() == 0


def look(watch: RuleMonitor, base: DriverView, **values: object) -> list[str]:
    return watch.update(replace(base, **values))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def seen(town: Town) -> Iterator[DriverView]:
    world = DrivingWorld(town, traffic_of_town(town, "static", 0))
    world.reset(0)
    yield world.driver_view()
    world.close()


def test_red_light_is_counted_once_and_only_when_crossed(town: Town, seen: DriverView) -> None:
    watch = RuleMonitor(town.network)
    red = int(SignalState.RED)
    begun = []
    for distance in (1.2, 0.7, 0.2, -0.3, -0.8, -1.3):
        begun += look(watch, seen, stop_line_distance_m=distance, signal_state=red, speed_mps=10.0)
    assert begun.count("red_light") == 1
    for state, speed in ((int(SignalState.GREEN), 10.0), (red, 0.0)):
        watch = RuleMonitor(town.network)
        begun = []
        for distance in (0.5, 0.2, -0.2, -0.5):
            begun += look(watch, seen, stop_line_distance_m=distance, signal_state=state, speed_mps=speed)
        assert "red_light" not in begun


def test_rules_of_the_road(town: Town, seen: DriverView) -> None:
    watch = RuleMonitor(town.network)
    assert not any(look(watch, seen) for _ in range(60))
    fast = [look(watch, seen, speed_mps=seen.speed_limit_mps + 4.0) for _ in range(60)]
    assert list(chain(*fast)) == ["speeding"]
    assert fast.index(["speeding"]) == 39
    normal = np.array([-np.sin(seen.heading_rad), np.cos(seen.heading_rad), 0.0])
    beyond = [
        look(watch, seen, position_m=seen.position_m - 12.0 * normal, offset_m=-12.0) for _ in range(20)
    ]
    assert {"off_road", "off_route"} <= set(chain(*beyond))
    watch = RuleMonitor(town.network)
    turned = [look(watch, seen, heading_rad=seen.heading_rad + np.pi, speed_mps=5.0) for _ in range(40)]
    assert list(chain(*turned)) == ["wrong_way"]


class Parked:
    """A driver who stands on the brake after some metres."""

    name = "parked"

    def read(self, view: DriverView) -> Controls:
        return Controls(throttle=0.4) if view.route_s_m < 3.0 else Controls(brake=1.0)

    def close(self) -> None:
        pass


def test_a_drive_that_gets_nowhere_ends_and_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recorder.drive.record.PATIENCE_S", 3.0)
    out = tmp_path / "stuck.mcap"
    result = record(RecordConfig(map="Town03", out=out, traffic="static"), device=Parked())
    assert result.stuck
    assert 3.0 < result.duration_s < 15.0
    assert [event.kind for event in Episode.load(out).events][-2:] == ["stuck", "end"]
    longer = RecordConfig(map="Town03", out=tmp_path / "asked.mcap", traffic="static", duration_s=20.0)
    result = record(longer, device=Parked())
    assert not result.stuck
    assert result.duration_s == pytest.approx(20.0, abs=0.02)


def test_recorded_controls_drive_the_same_again(drive: Path, tmp_path: Path) -> None:
    again = resimulate(drive, out=tmp_path / "again.mcap")
    assert again.first_difference_tick is None, again.verdict
    assert again.largest_m == 0.0
    first, second = Episode.load(drive), Episode.load(tmp_path / "again.mcap")
    assert first.ego.tobytes() == second.ego.tobytes()
    assert first.steps.tobytes() == second.steps.tobytes()


def test_a_single_changed_pedal_is_found(drive: Path, tmp_path: Path) -> None:
    """One throttle value, 0.01 larger, is reported within two ticks."""
    episode = Episode.load(drive)
    path = tmp_path / "changed.mcap"
    at = next(k for k in range(600, len(episode.ego)) if episode.ego["throttle"][k] > 0.1)
    frames = episode.timeline()
    with EpisodeWriter(path, episode.header) as writer:
        for k, row in enumerate(episode.ego):
            controls = episode.controls.at(k)
            if k == at:
                controls = replace(controls, throttle=controls.throttle + 0.01)
            if k % 10 == 0 and k // 10 < len(episode.steps):
                writer.step(k // 10, frames.actors_at(k * 5_000_000), frames.signals_at(k * 5_000_000))
            writer.ego(
                k,
                EgoRow(
                    position_m=row["position_m"],
                    quat_xyzw=row["quat_xyzw"],
                    velocity_world_mps=row["velocity_world_mps"],
                    omega_body_radps=row["omega_body_radps"],
                    controls=controls,
                    road_wheel_rad=float(row["road_wheel_rad"]),
                    speed_mps=float(row["speed_mps"]),
                ),
            )
    result = resimulate(path)
    assert result.first_difference_tick is not None
    assert at <= result.first_difference_tick <= at + 2
    assert str(result.first_difference_tick) in result.verdict


def test_edited_episodes_are_not_driven_again(drive: Path, tmp_path: Path) -> None:
    episode = Episode.load(drive)
    with EpisodeWriter(tmp_path / "cut.mcap", replace(episode.header, history=("cut 0 to 2 s",))) as writer:
        writer.ego(0, EgoRow(position_m=np.zeros(3), quat_xyzw=(0.0, 0.0, 0.0, 1.0)))
    with pytest.raises(EpisodeError, match="edited"):
        resimulate(tmp_path / "cut.mcap")


def test_keyboard_drive_with_pause_restart_and_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys reach the program as SDL events while a window of SDL's dummy display shows the drive."""
    pygame = pytest.importorskip("pygame")
    pytest.importorskip("moderngl")
    if not os.environ.get("DISPLAY"):
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    out = tmp_path / "keys.mcap"

    def press(key: int, hold_s: float = 0.05) -> None:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        time.sleep(hold_s)
        pygame.event.post(pygame.event.Event(pygame.KEYUP, key=key))

    def wait_for_ticks(count: int) -> None:
        """Until the drive has begun: keys pressed before would all be answered at its first tick."""
        end = time.monotonic() + 120.0
        while time.monotonic() < end:
            with suppress(EpisodeError):
                if len(open_episode(out).ego) >= count:
                    break
            time.sleep(0.1)

    def person() -> None:
        wait_for_ticks(20)
        press(pygame.K_UP, 2.0)
        press(pygame.K_c)
        press(pygame.K_h)
        press(pygame.K_p)
        time.sleep(0.3)
        press(pygame.K_k)
        press(pygame.K_p)
        press(pygame.K_UP, 1.5)
        press(pygame.K_BACKSPACE)
        time.sleep(2.0)
        press(pygame.K_DOWN, 0.7)
        # Nobody is there to see this key released: it ends the drive and closes the window.
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE))

    hands = threading.Thread(target=person)
    hands.start()
    result = record(RecordConfig(map="Town03", out=out, device="keyboard", traffic="static"))
    hands.join()
    assert len(result.attempts) == 1
    kept, given_up = Episode.load(out), Episode.load(result.attempts[0])
    checkpoint = next(event.tick for event in given_up.events if event.kind == "checkpoint")
    assert 0 < checkpoint < len(given_up.ego)
    assert kept.ego[: checkpoint + 2].tobytes() == given_up.ego[: checkpoint + 2].tobytes()
    assert any(event.kind == "checkpoint" for event in kept.events)
    assert np.ptp(kept.ego["position_m"][:, :2], axis=0).max() > 0.2
    assert resimulate(out).first_difference_tick is None


def test_a_recording_takes_the_weather_as_a_schedule(tmp_path: Path) -> None:
    """The same names and files as a replay; a wrong one is refused before anything is driven."""
    schedule = tmp_path / "shower.yaml"
    schedule.write_text("- {at_s: 0, weather: ClearNoon}\n- {at_s: 1, weather: HardRainNoon}\n")
    settings = {"map": "Town03", "duration_s": 0.5, "traffic": "static"}
    drive = record(RecordConfig(out=tmp_path / "a.mcap", weather=str(schedule), **settings))  # type: ignore[arg-type]
    assert len(Episode.load(drive.path).ego) > 50
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        record(RecordConfig(out=tmp_path / "b.mcap", weather=str(tmp_path / "nowhere.yaml"), **settings))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="ClearNoon"):
        record(RecordConfig(out=tmp_path / "b.mcap", weather="ClearNon", **settings))  # type: ignore[arg-type]
    assert not (tmp_path / "b.mcap").exists()
