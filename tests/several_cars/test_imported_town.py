"""Several cars in a town of OpenStreetMap."""

from pathlib import Path

from shared_fixtures.worlds.imported_towns import made
from shared_fixtures.worlds.street_sketches import Sketch

from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode


def test_three_cars_in_an_imported_town_do_not_touch_each_other(tmp_path: Path) -> None:
    """A minute of three cars on streets of OpenStreetMap, among traffic."""
    sketch = Sketch()
    sketch.way((-260.0, 0.0), (0.0, 0.0), (260.0, 20.0), highway="secondary", name="High Street")
    sketch.way((0.0, -220.0), (0.0, 0.0), (30.0, 230.0), highway="residential", name="Mill Lane")
    sketch.way((-120.0, 0.0), (-110.0, 90.0), (12.0, 88.0), highway="residential", name="Back Lane")
    made(sketch, tmp_path)
    out = tmp_path / "three.mcap"
    config = RecordConfig(map=str(tmp_path / "town.xodr"), out=out, cars=3, duration_s=60.0, seed=2)
    result = record(config)
    assert len(result.cars) == 3
    assert all(car["driven_m"] > 20.0 for car in result.cars)
    episode = Episode.load(out)
    ids = {str(car["id"]) for car in episode.header.cars}
    touches = [
        event.data["with"]
        for number in (1, 2, 3)
        for event in episode.of_car(number).events
        if event.kind == "collision"
    ]
    assert not ids.intersection(touches)
