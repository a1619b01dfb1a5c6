"""Record a drive: a device drives the ego through a living town, every tick is written to the episode."""

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from carlaloc_env.core import clock
from carlaloc_env.core.clock import TICK_HZ
from carlaloc_env.core.ego import DEFAULT_RIDE
from carlaloc_env.core.errors import ConfigError, DeviceError
from carlaloc_env.core.files.config_files import set_paths
from carlaloc_env.core.files.recordings import check_episode_output, recording_path, repair_command
from carlaloc_env.core.freed_memory import give_back_freed_memory
from carlaloc_env.driving.driven_car import DrivenCar
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.task.episode_start import EpisodeStart, car_routes
from carlaloc_env.physics.params import ride_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.actors import ActorCatalog
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town, without_movables
from carlaloc_env.traffic.traffic_config import traffic_of_town
from carlaloc_env.weather.schedule import Weather, weather_of
from recorder.devices.base import HUMAN, Device, check_device
from recorder.devices.human import HumanDevice
from recorder.devices.inputs import Inputs
from recorder.devices.keys import KeyPanel
from recorder.devices.policy import PolicyDriver
from recorder.devices.registry import open_device
from recorder.drive.drive_header import drive_header
from recorder.drive.session import DriveSession
from recorder.episode.ego_messages import VIOLATIONS
from recorder.episode.episode import Episode
from recorder.episode.summary import collision_count, driven_distance_m
from recorder.episode.writer import EpisodeWriter
from recorder.window.cockpit import WindowCockpit
from recorder.window.opening import Opening

Progress = Callable[[float, float], None]
"""Called with seconds driven and metres along the route."""

MOST_CARS = 16
"""Cars of a drive at most."""
PATIENCE_S = 300.0
"""A drive without a duration ends after so long without progress [s]; others wait 150 s at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordConfig:
    """Configuration of a drive: town, length, file."""

    map: str = "Town03"
    """Town, or path of an OpenDRIVE file."""
    out: Path = Path("drive.mcap")
    """Episode to write."""
    device: str = "scripted"
    """Input device, or a ``.py`` file that drives (`recorder.devices.policy`)."""
    duration_s: float | None = None
    """Length of the drive [s]; None: until the route has been driven once."""
    seed: int = 0
    """Seed of the traffic and of the scripted driver."""
    traffic: str = "dynamic"
    """Level of the town's traffic: ``dynamic``, ``static``, ``empty`` or a fraction."""
    ride: str = DEFAULT_RIDE
    """How the body answers to the road: ``standard``, or ``real`` as measured on cars."""
    route: str | tuple[tuple[float, float], ...] = "town"
    """``town``, ``random`` (by the seed), or points (x, y) near lanes that it leads through [m]."""
    cars: int = 1
    """Number of cars in one world [1 and more]; the program drives all but the first."""
    overlap: float = 0.5
    """Share of its route that each car has in common with the next, where there are several [0 to 1]."""
    start: str | float = 0.0
    """Share of the route that is left out before the car [0 to below 1]; ``anywhere``: by the seed."""
    overwrite: bool = False
    """Whether an older episode of this name is replaced."""
    window: bool | None = None
    """Whether a window shows the drive; None: where a person drives."""
    weather: str = "ClearNoon"
    """Weather in the window, by name or as a schedule (``.yaml``); a replay may choose any other."""

    def __post_init__(self) -> None:
        set_paths(self, "out")
        check_device(self.device)
        EpisodeStart.of({"route": self.route, "start": self.start})
        ride_by_name(self.ride)
        if not 1 <= self.cars <= MOST_CARS:
            raise ConfigError(f"{self.cars} cars; give 1 to {MOST_CARS}")
        if not 0.0 <= self.overlap <= 1.0:
            raise ConfigError(f"overlap {self.overlap:g}; give a share of the routes from 0 to 1")
        if self.duration_s is not None and not 0.0 < self.duration_s <= 86400.0:
            raise ConfigError(f"duration {self.duration_s:g} s; give more than 0 and at most 86400 s")

    @property
    def wants_window(self) -> bool:
        """Whether a window shows the drive."""
        return self.device in HUMAN if self.window is None else self.window


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordResult:
    """The recorded file and its figures."""

    path: Path
    """The episode."""
    duration_s: float
    """Length of the drive [s]."""
    route_m: float
    """Distance along the route [m]."""
    driven_m: float
    """Distance driven [m], in the plane; it differs from that along the route where the driver leaves it."""
    collisions: int
    """Number of collisions."""
    violations: Mapping[str, int] = field(default_factory=dict)
    """How often each rule was broken."""
    attempts: tuple[Path, ...] = ()
    """Earlier attempts, given up at a restart."""
    photos: tuple[Path, ...] = ()
    """Photos that the driver took, PNG files beside the episode."""
    slowest: float = 1.0
    """Lowest speed of the world over real time, of drives in real time."""
    stuck: bool = False
    """Whether a drive without a duration ended early, since the car made no progress for `PATIENCE_S`."""
    cars: tuple[Mapping[str, float], ...] = ()
    """Of every car, where there are several: ``driven_m``, ``route_m`` and ``collisions``."""
    passed_mps: float | None = None
    """Speed at which the end of an open route was passed [m/s]; None where the car did not, or stopped."""


def record(
    config: RecordConfig,
    *,
    device: Device | None = None,
    progress: Progress | None = None,
    opening: Opening | None = None,
) -> RecordResult:
    """Drive and record until the duration or the route is over, or the driver ends it.

    Args:
        config: Configuration of the drive.
        device: The driver; opened by its name when left out.
        progress: Called four times a second with the progress of the drive.
        opening: The window, if it is open already; it is closed afterwards.

    Raises:
        ConfigError: unknown town, device, weather or traffic level.
        DeviceError: the device is not connected, or no window can be opened.
        EpisodeError: the episode exists already or cannot be written.
    """
    check_episode_output(config.out, overwrite=config.overwrite)
    with ExitStack() as stack:
        if config.wants_window:
            opening = stack.enter_context(opening or Opening(config.map))
        driver = device or open_device(config.device, config.seed, window=config.wants_window)
        stack.callback(driver.close)
        drive = _Drive(config, driver, progress, stack)
        if opening is not None:
            return drive.in_window(opening)
        drive.prepare()
        if isinstance(driver, HumanDevice):
            return drive.run(lambda: drive.session.run_live(driver, None))
        patience_s = PATIENCE_S if config.duration_s is None else math.inf
        return drive.run(lambda: drive.session.run_freely(patience_s=patience_s))


class _Drive:
    """One recording, from town to result; `stack` closes what it opens."""

    def __init__(
        self, config: RecordConfig, driver: Device, progress: Progress | None, stack: ExitStack
    ) -> None:
        self._config, self._driver, self._progress, self._stack = config, driver, progress, stack
        stack.callback(self._let_go)

    def _let_go(self) -> None:
        """Free the town, which drive and session would keep in a ring until somebody looks for rings."""
        for name in ("session", "world"):
            vars(self).pop(name, None)
        give_back_freed_memory()

    def prepare(self, show: Callable[[Town, Weather], None] | None = None) -> None:
        """Build the living town.

        Args:
            show: Called with town and weather as soon as they are ready; may be slow.
        """
        config = self._config
        weather = weather_of(config.weather)
        town = load_town(config.map)
        traffic = traffic_of_town(town, config.traffic, config.seed)
        if not traffic.parked_cars:
            town = without_movables(town)
        with ThreadPoolExecutor(1) as pool:
            shown = None if show is None else pool.submit(show, town, weather)
            self.world = DrivingWorld(town, traffic, ride=config.ride, cars=config.cars)
            self._stack.callback(self.world.close)
            start = EpisodeStart.of({"route": config.route, "start": config.start})
            rng = clock.stream(config.seed, "drive/route")
            self._routes = car_routes(start, town, rng, config.cars, config.overlap)
            for car, driven in zip(self.world.cars, self._routes, strict=True):
                car.route = driven.route
            if isinstance(self._driver, PolicyDriver):
                stage = SensorStage(self.world.town, seed=config.seed, weather=weather)
                self._stack.callback(stage.close)
                self._driver.sit_in(self.world, stage)
            if shown is not None:
                shown.result()
        self.session = DriveSession(
            self.world,
            self._driver,
            seed=config.seed,
            begin=self._begin,
            finished=_arrived if config.duration_s is None else lambda _: False,
            end_tick=round((config.duration_s or 86400.0) * TICK_HZ),
            progress=self._progress,
            others=lambda: [open_device("scripted", config.seed + k) for k in range(1, config.cars)],
        )
        self.session.status.headlamps = weather.at(0).is_night

    def in_window(self, opening: Opening) -> RecordResult:
        """Drive in a window that shows loading progress until the first image is drawn."""
        driver = self._driver
        panel = driver if isinstance(driver, HumanDevice) else KeyPanel(Inputs(window=True))
        self._stack.callback(panel.close)
        cockpit = self._stack.enter_context(WindowCockpit(opening.window))
        opening.run(f"building {Path(self._config.map).stem}", lambda: self.prepare(cockpit.prepare))

        def draw_first() -> None:
            # The recording begins anew afterwards, when the driver sees the road.
            self.world.reset(self._config.seed)
            cockpit.wait_for_first(self.world, self.session.status)

        opening.run("drawing", draw_first)
        opening.finish()
        return self.run(lambda: self.session.run_live(panel, cockpit))

    def run(self, live: Callable[[], None]) -> RecordResult:
        """Drive; what has been driven when it fails stays readable under its `.recording` name."""
        session = self.session
        session.start()
        try:
            live()
            session.finish()
        except BaseException as error:
            session.listener.writer.abandon()
            out = self._config.out
            where = (
                f"the drive until here ({session.duration_s:.1f} s) is in {recording_path(out)}; "
                f"make it whole with: {repair_command(out)}"
            )
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(where) from None
            if isinstance(error, DeviceError):
                raise DeviceError(f"{error}; {where}") from error
            raise
        session.listener.writer.close()
        counts, episode = session.listener.counts, Episode.load(self._config.out)
        return RecordResult(
            path=self._config.out,
            duration_s=session.duration_s,
            route_m=session.route_m,
            driven_m=driven_distance_m(episode),
            collisions=counts["collision"],
            violations={kind: counts[kind] for kind in VIOLATIONS if counts[kind]},
            attempts=tuple(session.attempts),
            photos=tuple(session.photos),
            slowest=session.slowest,
            stuck=session.stuck,
            cars=self._figures(episode),
            passed_mps=self._passed_mps(),
        )

    def _figures(self, episode: Episode) -> tuple[Mapping[str, float], ...]:
        """Figures of every car, where there are several."""
        drives = [episode.of_car(number + 1) for number in range(len(self.world.cars))]
        return tuple(
            {
                "driven_m": driven_distance_m(drive),
                "route_m": max(car.route_s_m, 0.0),
                "collisions": collision_count(drive),
            }
            for car, drive in zip(self.world.cars, drives, strict=True)
            if len(drives) > 1
        )

    def _passed_mps(self) -> float | None:
        speed = abs(self.world.state.speed_mps)
        stopped = self.world.route.closed or speed < _STANDS_MPS
        return None if stopped or not self.session.is_driven else speed

    def _begin(self, catalog: ActorCatalog) -> EpisodeWriter:
        config, driver = self._config, self._driver
        header = drive_header(
            self.world, self._routes, catalog, devices=[driver.name, *["scripted"] * (config.cars - 1)],
            action=driver.action if isinstance(driver, PolicyDriver) else "",
            extra={} if config.ride == DEFAULT_RIDE else {"ride": config.ride},
        )  # fmt: skip
        return EpisodeWriter(config.out, header, overwrite=config.overwrite)


_STANDS_MPS = 0.05
_AT_THE_END_M = 8.0


def _arrived(world: DrivingWorld) -> bool:
    """Whether all cars have driven their routes: to the end, or to a stop just before that of an open one."""
    return all(_is_at_end(car) for car in world.cars)


def _is_at_end(car: DrivenCar) -> bool:
    left_m = car.route.length_m - car.route_s_m
    if car.route.closed:
        return left_m <= 0.0
    # A car beyond the end is projected on it, to the last bits.
    return left_m < 0.01 or (left_m <= _AT_THE_END_M and car.state.speed_mps < _STANDS_MPS)
