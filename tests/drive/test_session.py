"""Drives from start to end: with keys and a window, and without getting anywhere."""

import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.drives.driven_again import assert_same_again

from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.driving.driver_view import DriverView
from recorder.devices.human import HumanDevice
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.window.window import WINDOW_PX


class Parked:
    """A driver who stands on the brake after some metres."""

    name = "parked"

    def read(self, view: DriverView) -> Controls:
        return Controls(throttle=0.4) if view.route_s_m < 3.0 else Controls(brake=1.0)

    def close(self) -> None:
        pass


def test_a_drive_that_gets_nowhere_ends_and_is_kept(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings: dict[str, Any] = {"map": str(straight_map), "traffic": "empty"}
    monkeypatch.setattr("recorder.drive.record.PATIENCE_S", 3.0)
    out = tmp_path / "stuck.mcap"
    result = record(RecordConfig(out=out, **settings), device=Parked())
    assert result.stuck
    assert 3.0 < result.duration_s < 15.0
    assert [event.kind for event in Episode.load(out).events][-2:] == ["stuck", "end"]
    longer = RecordConfig(out=tmp_path / "asked.mcap", duration_s=15.0, **settings)
    result = record(longer, device=Parked())
    assert not result.stuck
    assert result.duration_s == pytest.approx(15.0, abs=0.02)


def test_keyboard_drive_with_pause_restart_and_views(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Keys reach the program as SDL events while a window of SDL's dummy display shows the drive."""
    pygame = pytest.importorskip("pygame")
    pytest.importorskip("moderngl")
    if not os.environ.get("DISPLAY"):
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    out = tmp_path / "keys.mcap"
    driven: list[int] = []
    read = HumanDevice.read

    def counted(self: HumanDevice, view: DriverView) -> Controls:
        driven.append(view.tick)
        return read(self, view)

    monkeypatch.setattr(HumanDevice, "read", counted)

    def wait_for_ticks(count: int) -> None:
        """Until the car has been driven so much further: a busy machine drives slowly."""
        end_s, enough = time.monotonic() + 600.0, len(driven) + count
        while len(driven) < enough and time.monotonic() < end_s:
            time.sleep(0.01)

    def press(key: int, hold_ticks: int = 0) -> None:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        time.sleep(0.05)
        wait_for_ticks(hold_ticks)
        pygame.event.post(pygame.event.Event(pygame.KEYUP, key=key))

    def person() -> None:
        # Keys pressed before the drive has begun would all be answered at its first tick.
        wait_for_ticks(20)
        press(pygame.K_UP, 400)
        press(pygame.K_c)
        press(pygame.K_h)
        press(pygame.K_p)
        press(pygame.K_f)
        time.sleep(0.3)
        press(pygame.K_k)
        press(pygame.K_p)
        press(pygame.K_UP, 200)
        press(pygame.K_BACKSPACE)
        wait_for_ticks(200)
        press(pygame.K_DOWN, 100)
        # Nobody is there to see this key released: it ends the drive and closes the window.
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE))

    hands = threading.Thread(target=person)
    hands.start()
    result = record(RecordConfig(map=str(straight_map), out=out, device="keyboard", traffic="static"))
    hands.join()
    assert len(result.attempts) == 1
    (photo,) = result.photos
    assert photo == tmp_path / "keys_photo1.png"
    assert photo.read_bytes().startswith(b"\x89PNG")
    picture = pygame.surfarray.array3d(pygame.image.load(str(photo)))
    assert picture.shape == (*WINDOW_PX, 3)
    assert picture.std() > 20.0, "it shows the street"
    kept, given_up = Episode.load(out), Episode.load(result.attempts[0])
    checkpoint = next(event.tick for event in given_up.events if event.kind == "checkpoint")
    assert 0 < checkpoint < len(given_up.ego)
    assert kept.ego[: checkpoint + 2].tobytes() == given_up.ego[: checkpoint + 2].tobytes()
    assert any(event.kind == "checkpoint" for event in kept.events)
    assert np.ptp(kept.ego["position_m"][:, :2], axis=0).max() > 0.2
    assert_same_again(out, straight_map)


def test_a_recording_takes_the_weather_as_a_schedule(straight_map: Path, tmp_path: Path) -> None:
    """The same names and files as a replay; a wrong one is refused before anything is driven."""
    schedule = tmp_path / "shower.yaml"
    schedule.write_text("- {at_s: 0, weather: ClearNoon}\n- {at_s: 1, weather: HardRainNoon}\n")
    settings = {"map": str(straight_map), "duration_s": 0.5, "traffic": "static"}
    drive = record(RecordConfig(out=tmp_path / "a.mcap", weather=str(schedule), **settings))  # type: ignore[arg-type]
    assert len(Episode.load(drive.path).ego) > 50
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        record(RecordConfig(out=tmp_path / "b.mcap", weather=str(tmp_path / "nowhere.yaml"), **settings))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="ClearNoon"):
        record(RecordConfig(out=tmp_path / "b.mcap", weather="ClearNon", **settings))  # type: ignore[arg-type]
    assert not (tmp_path / "b.mcap").exists()
