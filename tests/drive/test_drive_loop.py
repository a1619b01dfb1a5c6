"""The loop of a person's drive: the end of the route, a restart, a car that is stuck, touches of one wall."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.drives.episodes import header_of

from carlaloc_env.core.clock import TICK_HZ
from carlaloc_env.core.ego import Controls
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoTick
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import traffic_of_town
from recorder.cli.main import main
from recorder.devices.human import HumanDevice
from recorder.devices.inputs import Press
from recorder.devices.keys import BACK, FORWARD
from recorder.drive.episode_listener import EpisodeListener
from recorder.drive.pacer import Pacer
from recorder.drive.record import RecordConfig, _arrived, record
from recorder.drive.session import DriveSession
from recorder.episode.episode import Episode
from recorder.episode.summary import summarise
from recorder.episode.writer import EpisodeWriter
from recorder.window.drive_status import DriveStatus

Plan = Callable[[DrivingWorld, int], tuple[set[int], str]]
"""Keys held and pressed, after the world and the number of the picture."""


class Hands:
    """Events of a keyboard, by a plan."""

    closed, lost, gained = False, (), ()

    def __init__(self, plan: Plan) -> None:
        self._plan, self._number = plan, 0
        self.keys: set[int] = set()
        self.presses: list[Press] = []
        self.world: Any = None

    def __iter__(self) -> Any:
        return iter(())

    def pump(self) -> None:
        self.keys, pressed = self._plan(self.world, self._number)
        self.presses = [Press(key=ord(key)) for key in pressed]
        self._number += 1

    def close(self) -> None:
        pass


@dataclass
class Eyes:
    """A cockpit that notes what it shows."""

    seen: list[tuple[float, float, str | None, str, bool, int]] = field(default_factory=list)

    def show(self, world: DrivingWorld, status: DriveStatus) -> None:
        self.seen.append(
            (world.route_s_m, world.state.speed_mps, status.message, status.indicator,
             status.controls.reverse, world.tick_count)
        )  # fmt: skip

    def photo(self, world: DrivingWorld, status: DriveStatus, path: Path) -> None:
        path.write_bytes(b"")


def drive(map_path: Path, out: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> tuple[Eyes, list[float]]:
    """Drive by a plan, as fast as the machine can; what was shown, and the progress that was reported."""
    monkeypatch.setattr(Pacer, "due", lambda self: 10)
    monkeypatch.setattr("recorder.drive.session._FAREWELL_S", 0.0)
    town = load_town(map_path)
    world = DrivingWorld(town, traffic_of_town(town, "empty", 0))
    hands, eyes, progress = Hands(plan), Eyes(), list[float]()
    hands.world = world
    driver = HumanDevice("keyboard", hands, [])  # type: ignore[arg-type]
    session = DriveSession(
        world, driver, seed=0, begin=lambda catalog: EpisodeWriter(out, header_of(0)), finished=_arrived,
        end_tick=60 * TICK_HZ, progress=lambda _, route_m: progress.append(route_m),
    )  # fmt: skip
    session.start()
    session.run_live(driver, eyes)
    session.finish()
    session.listener.writer.close()
    world.close()
    return eyes, progress


def test_the_end_is_announced_in_time_and_ends_the_drive(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A person who only accelerates: half of gentle braking's way is left when the announcement comes."""

    def plan(world: DrivingWorld, number: int) -> tuple[set[int], str]:
        return ({FORWARD[0]} if world.state.speed_mps < 11.0 else set()), ""

    eyes, _ = drive(straight_map, tmp_path / "a.mcap", plan, monkeypatch)
    length_m = load_town(straight_map).route.length_m  # type: ignore[union-attr]
    told = [(s, v) for s, v, message, *_ in eyes.seen if message and "the route ends in" in message]
    assert not any(message for s, _, message, *_ in eyes.seen if s < length_m - 100.0)
    left_m, speed = length_m - told[0][0], told[0][1]
    assert speed > 10.0
    assert speed**2 / (2.0 * left_m) < 2.0, "a stop without hard braking"
    assert eyes.seen[-1][2] == "the route has been driven: the drive ends here"
    assert eyes.seen[-1][0] == pytest.approx(length_m, abs=0.02)


class Racer:
    """Never brakes."""

    name = "racer"

    def read(self, view: DriverView) -> Controls:
        steer = -0.05 * view.offset_m - 0.5 * view.heading_rad
        return Controls(steer=max(-1.0, min(1.0, steer)), throttle=0.5 * (view.speed_mps < 11.0))

    def close(self) -> None:
        pass


def test_who_passes_the_end_drives_no_farther_and_reads_it(
    straight_map: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorder.drive.record.PATIENCE_S", 5.0)
    settings: dict[str, Any] = {"map": str(straight_map), "traffic": "empty"}
    result = record(RecordConfig(out=tmp_path / "fast.mcap", **settings), device=Racer())
    ego = Episode.load(result.path).ego
    assert not result.stuck
    assert result.passed_mps == pytest.approx(ego["speed_mps"][-1], abs=0.01)
    assert result.passed_mps > 5.0  # type: ignore[operator]
    monkeypatch.setattr("recorder.drive.record.open_device", lambda *_, **__: Racer())
    command = ["record", "--map", str(straight_map), "--traffic", "empty", "--out", str(tmp_path / "b.mcap")]
    assert main(command) == 0
    assert f"was passed at {3.6 * result.passed_mps:.0f} km/h" in capsys.readouterr().out  # type: ignore[operator]


def test_a_restart_begins_afresh(straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In reverse gear, behind the start, with an indicator and a message: all of that is gone after it."""

    def plan(world: DrivingWorld, number: int) -> tuple[set[int], str]:
        pressed = {5: "r", 6: "q", 99: "f", 100: "\b", 200: "\x1b"}
        return {FORWARD[0]}, pressed.get(number, "")

    eyes, progress = drive(straight_map, tmp_path / "a.mcap", plan, monkeypatch)
    ticks = [tick for *_, tick in eyes.seen]
    begun = int(np.flatnonzero(np.diff(ticks) < 0)[0]) + 1
    before, after = eyes.seen[begun - 2], eyes.seen[begun:]
    assert before[4]
    assert before[3] == "left"
    assert any("photo" in (message or "") for _, _, message, *_ in eyes.seen[:begun])
    assert min(speed for _, speed, *_ in eyes.seen[:begun]) < -1.0
    assert not any(reverse or indicator or message for _, _, message, indicator, reverse, _ in after)
    assert min(speed for _, speed, *_ in after) > -0.05
    assert after[-1][1] > 1.0
    assert min(progress) == 0.0
    (end,) = (
        event for event in Episode.load(tmp_path / "a_attempt1.mcap").events if event.kind == "given_up"
    )
    assert end.data == {"checkpoint_tick": 0}


def test_a_restart_keeps_what_was_switched_on_at_the_checkpoint(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plan(world: DrivingWorld, number: int) -> tuple[set[int], str]:
        pressed = {5: "r", 6: "q", 50: "k", 60: "q", 61: "l", 100: "\b", 101: "\x1b"}
        return {FORWARD[0]} if number < 70 else {BACK[0]}, pressed.get(number, "")

    eyes, _ = drive(straight_map, tmp_path / "a.mcap", plan, monkeypatch)
    assert eyes.seen[-1][3:5] == ("left", True)


def test_a_stuck_car_is_offered_the_restart(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After three seconds of throttle without a metre of way, and no longer once the car moves."""

    def plan(world: DrivingWorld, number: int) -> tuple[set[int], str]:
        held = {FORWARD[0], BACK[0]} if 20 < number < 140 else {FORWARD[0]}
        return held, "\x1b" if number == 260 else ""

    monkeypatch.setattr(
        "recorder.devices.control_shaping.KeyPedals.update",
        lambda self, forward, back: (0.9 * forward, 1.0 * back),
    )
    eyes, _ = drive(straight_map, tmp_path / "a.mcap", plan, monkeypatch)
    offered = [
        tick for _, _, message, *_, tick in eyes.seen if message and "backspace: back to the start" in message
    ]
    assert 4.0 < offered[0] / TICK_HZ < 6.0, "the car stands from about 1.5 s on"
    assert offered[-1] < 9.5 * TICK_HZ
    assert len(eyes.seen) > 240


def test_touches_of_one_wall_are_one_collision(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight touches of a car that is pushed, with pauses; a car beside it; away and back to the wall."""
    monkeypatch.setattr(EpisodeWriter, "ego", lambda *_: None)
    out = tmp_path / "a.mcap"
    listener = EpisodeListener(lambda catalog: EpisodeWriter(out, header_of(0)))
    listener.on_start(header_of(0).catalog)
    touched = {**dict.fromkeys(range(400, 6000, 700)), 7000: 8, 9000: None, 9002: None}
    for tick in range(9100):
        x_m = 3.0 if 7500 < tick < 8500 else 0.0
        car = EgoTick((x_m, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3, 0.0, 0.0, [0.0] * 4)
        listener.on_tick(tick, car, Controls())
        if tick in touched:
            contact = Contact(actor_id=touched[tick], impulse_ns=900.0, position_m=(0.0, 0.0, 0.0))
            listener.on_contact(tick, contact)
    listener.writer.close()
    episode = Episode.load(out)
    touches = [event for event in episode.events if event.kind == "collision"]
    assert len(touches) == len(touched), "each touch that begins stays in the file"
    assert [event.tick for event in touches if not event.data.get("again")] == [400, 7000, 9000]
    assert listener.counts["collision"] == summarise(episode).collisions == 3
