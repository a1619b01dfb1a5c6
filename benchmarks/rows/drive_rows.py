"""Interactive driving: pictures per second in the window, and the cost of recording."""

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

from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.timeline.actors import ActorCatalog
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.weather.schedule import weather_of
from recorder.devices.registry import open_device
from recorder.drive.episode_listener import EpisodeListener
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter
from recorder.window.drive_status import DriveStatus

VEHICLES, WALKERS = 266, 34
_CALM = TrafficConfig(vehicles=50, walkers=10, seed=SEED)


def window(bench: Bench) -> Row:
    """The driver's window in Town03 among 50 + 10 others, while the world is recorded in real time."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    what = "window from the driver's seat, 50 + 10 actors, in real time"
    row = partial(Row, name="window", what=what, unit="pictures/s", target=20.0)
    from recorder.window.cockpit import WindowCockpit
    from recorder.window.window import Window

    screen = Window("benchmark")
    cockpit = WindowCockpit(screen)
    cockpit.prepare(bench.town, weather_of("ClearNoon"))
    world, driver = DrivingWorld(bench.town, _CALM), open_device("scripted", SEED)
    rates: dict[str, float] = {}
    paces: list[float] = []
    with cockpit, tempfile.TemporaryDirectory() as folder:
        log = _log(bench, Path(folder) / "drive.mcap")
        world.reset(SEED, log)
        try:
            cockpit.wait_for_first(world, DriveStatus(device="scripted"))
        except CarlaLocError as error:
            return row(value=None, note=str(error))
        for number, view in enumerate(("seat", "chase", "above")):
            status = DriveStatus(device="scripted", view=number)
            drive = partial(_drive_with_pictures, world, driver, cockpit, status)
            drive(1.0 if bench.quick else 3.0)  # the first pictures compile shaders and find their size
            rates[view], pace = drive(1.0 if bench.quick else 15.0)
            paces.append(pace)
        log.writer.close()
        is_live = cockpit.is_live
    screen.close()
    driver.close()
    world.close()
    if not is_live:
        return row(value=None, note="the process that draws the pictures ended; its traceback stands above")
    note = (
        f"chase {rates['chase']:.1f}, from above {rates['above']:.1f} pictures/s; "
        f"the world at {min(paces):.0%} of real time"
    )
    return row(value=rates["seat"], note=note, detail=rates)


def _drive_with_pictures(
    world: DrivingWorld, driver: Any, cockpit: Any, status: DriveStatus, seconds: float
) -> tuple[float, float]:
    """Pictures in a second of a stretch of the drive, and how fast the world ran over real time."""
    from recorder.drive.pacer import Pacer

    pacer, shown, ticks = Pacer(), cockpit.images, world.tick_count
    began = time.perf_counter()
    while (spent := time.perf_counter() - began) < seconds:
        for _ in range(pacer.due()):
            world.tick(driver.read(world.driver_view()))
        cockpit.show(world, status)
    return (cockpit.images - shown) / spent, (world.tick_count - ticks) * TICK_S / spent


def _log(bench: Bench, path: Path) -> TimedLog:
    """A log that records a drive of the bench's town to a file."""

    def begin(catalog: ActorCatalog) -> EpisodeWriter:
        header = EpisodeHeader(map_name=TOWN, town_hash=bench.town.town_hash, seed=SEED, catalog=catalog)
        return EpisodeWriter(path, header)

    return TimedLog(begin)


class TimedLog(EpisodeListener):
    """A log that measures its CPU time."""

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
    """CPU time of recording per simulated second, among 300 others."""
    steps = 20 if bench.quick else 400
    traffic = TrafficConfig(vehicles=VEHICLES, walkers=WALKERS, seed=SEED)
    world, driver = DrivingWorld(bench.town, traffic), open_device("scripted", SEED)
    with tempfile.TemporaryDirectory() as folder:
        log = _log(bench, Path(folder) / "drive.mcap")
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
