"""The scripted driver on a virtual wheel: device, window and recorder are those of a person's drive."""

from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.clock import TICK_HZ
from recorder.devices.scripted.hand import IMAGE_HZ
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.summary import summarise

pytest.importorskip("pygame")


def drive(straight_map: Path, out: Path, device: str, window: bool | None = None) -> Episode:
    """A drive along the whole straight."""
    record(RecordConfig(map=str(straight_map), out=out, device=device, traffic="empty", window=window))
    return Episode.load(out)


@pytest.fixture(scope="module")
def by_hand(straight_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """A drive by hand, without a window."""
    return drive(straight_map, tmp_path_factory.mktemp("hand") / "hand.mcap", "hand")


def test_a_hand_drives_as_its_driver_wants(by_hand: Episode, straight_map: Path, tmp_path: Path) -> None:
    """To the end, in about the same time, where the driver without hands drives."""
    scripted = drive(straight_map, tmp_path / "scripted.mcap", "scripted")
    assert by_hand.header.device == "wheel: scripted hand (1209:0001)"
    assert summarise(by_hand).route_m == pytest.approx(summarise(scripted).route_m, abs=2.0)
    assert by_hand.duration_s == pytest.approx(scripted.duration_s, rel=0.03)
    side_m = by_hand.ego["position_m"][:, 1] - by_hand.ego["position_m"][0, 1]
    assert np.abs(side_m).max() < 0.8
    assert not summarise(by_hand).violations


def test_a_device_is_read_once_an_image_in_steps_of_16_bits(by_hand: Episode) -> None:
    """Raw axes stay for six or seven ticks of an image, and are whole numbers of 1/32768."""
    raw = by_hand.ego["raw_steer"].astype(np.float64)
    changes = np.diff(np.flatnonzero(np.diff(raw[TICK_HZ:])))
    assert changes.min() >= TICK_HZ // IMAGE_HZ
    steps = raw * 32768.0
    assert np.abs(steps - np.round(steps)).max() < 0.01
    assert len(np.unique(raw)) > 50
    applied = by_hand.ego["steer"]
    assert np.abs(np.diff(applied)).max() < 0.5 * np.abs(np.diff(raw)).max()


def test_a_window_changes_nothing(
    by_hand: Episode, straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drive counts images: with a window, on a busy machine, it has the same bytes."""
    pytest.importorskip("moderngl")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    seen = drive(straight_map, tmp_path / "seen.mcap", "hand", window=True)
    assert seen.ego.tobytes() == by_hand.ego.tobytes()
