"""A person at a wheel, the virtual one of a scripted hand, among cars that the program drives."""

from pathlib import Path

import numpy as np
import pytest

from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode


def test_a_person_and_scripted_cars_drive_in_one_world(tmp_path: Path) -> None:
    """The person's axes reach the first car alone, through all of a person's code; all cars drive on."""
    pytest.importorskip("pygame")
    out = tmp_path / "three.mcap"
    config = RecordConfig(
        map="Town01", out=out, device="hand", cars=3, overlap=1.0, traffic="0.1", duration_s=10.0, seed=3
    )
    result = record(config)
    assert [car["driven_m"] > 5.0 for car in result.cars] == [True] * 3
    assert not any(car["collisions"] for car in result.cars)
    episodes = [Episode.load(out, car=number) for number in (1, 2, 3)]
    assert [episode.header.device.partition(":")[0] for episode in episodes] == [
        "wheel",
        "scripted",
        "scripted",
    ]
    by_hand, *scripted = (episode.raw_controls.throttle for episode in episodes)
    # A device is read once an image: a hand's pedal rests for several ticks, a program's moves in each.
    moves = [np.count_nonzero(np.diff(pedal)) / np.count_nonzero(pedal) for pedal in (by_hand, *scripted)]
    assert moves[0] < 0.3
    assert min(moves[1:]) > 0.5
