"""What a person who drives feels: pictures in the window, and what recording takes."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from bench import Bench, Row
from scenario import SEED, TOWN

from carlaloc_env.clock import STEP_TICKS, TICK_S
from carlaloc_env.driving import DrivingWorld
from carlaloc_env.errors import CarlaLocError
from carlaloc_env.timeline import ActorCatalog
from carlaloc_env.traffic.world import TrafficConfig
from carlaloc_env.weather import weather_by_name
from recorder.devices.registry import open_device
from recorder.drive_log import DriveLog
from recorder.drive_status import DriveStatus
from recorder.episode import EpisodeHeader, EpisodeWriter

VEHICLES, WALKERS = 266, 34
_CALM = TrafficConfig(vehicles=50, walkers=10, seed=SEED)


def window(bench: Bench) -> Row:
    """The driver's window in Town03 among 50 + 10 others: ticks in real time between two pictures."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    what = "window from the driver's seat, 50 + 10 actors, driving in real time"
    row = partial(Row, name="window", what=what, unit="pictures/s", target=20.0)
    from recorder.window.cockpit import WindowCockpit

    try:
        cockpit = WindowCockpit(bench.town, weather_by_name("ClearNoon"))
    except CarlaLocError as error:
        return row(value=None, note=str(error))
    world, driver = DrivingWorld(bench.town, _CALM), open_device("scripted", SEED)
    rates: dict[str, float] = {}
    with cockpit:
        world.reset(SEED)
        for number, view in enumerate(("seat", "chase", "above")):
            status = DriveStatus(device="scripted", view=number)
            rates[view] = _pictures_per_s(world, driver, cockpit, status, 1.0 if bench.quick else 15.0)
    driver.close()
    world.close()
    note = f"chase {rates['chase']:.0f}, from above {rates['above']:.0f} pictures/s"
    return row(value=rates["seat"], note=note, detail=rates)


def _pictures_per_s(
    world: DrivingWorld, driver: Any, cockpit: Any, status: DriveStatus, seconds: float
) -> float:
    """Pictures in a second of a stretch of the drive, with the ticks that fall due meanwhile."""
    from recorder.pacing import Pacer

    for _ in range(10):  # the first ones compile shaders and find their size
        cockpit.show(world, status)
    pacer, shown = Pacer(), 0
    began = time.perf_counter()
    while time.perf_counter() - began < seconds:
        for _ in range(pacer.due()):
            world.tick(driver.read(world.driver_view()))
        cockpit.show(world, status)
        shown += 1
    return shown / (time.perf_counter() - began)


class TimedLog(DriveLog):
    """A log that counts the processor time which it takes."""

    spent_s = 0.0

    def __getattribute__(self, name: str) -> Any:
        found = super().__getattribute__(name)
        return self._timed(found) if name in ("on_tick", "on_step", "on_contact") else found

    def _timed(self, call: Callable[..., None]) -> Callable[..., None]:
        def timed(*arguments: Any) -> None:
            began = time.process_time()
            call(*arguments)
            self.spent_s += time.process_time() - began

        return timed


def recording(bench: Bench) -> Row:
    """Processor time that recording takes out of a second of driving among 300 others."""
    steps = 20 if bench.quick else 400
    traffic = TrafficConfig(vehicles=VEHICLES, walkers=WALKERS, seed=SEED)
    world, driver = DrivingWorld(bench.town, traffic), open_device("scripted", SEED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.mcap"

        def begin(catalog: ActorCatalog) -> EpisodeWriter:
            header = EpisodeHeader(
                map_name=TOWN, map_hash=bench.town.content_hash, seed=SEED, catalog=catalog
            )
            return EpisodeWriter(path, header)

        log = TimedLog(begin)
        world.reset(SEED, log)
        log.spent_s = 0.0
        for _ in range(steps * STEP_TICKS):
            world.tick(driver.read(world.driver_view()))
        driven_s = steps * STEP_TICKS * TICK_S
        size = log.writer.size_bytes
        log.writer.close()
    driver.close()
    world.close()
    return Row(
        name="recording",
        what=f"recording of a drive among {VEHICLES} vehicles and {WALKERS} walkers",
        value=100.0 * log.spent_s / driven_s,
        unit="% of a core",
        target=10.0,
        at_least=False,
        note=f"{size / driven_s * 3600 / 1e6:.0f} MB an hour",
        detail={"size_mb_per_h": size / driven_s * 3600 / 1e6},
    )
