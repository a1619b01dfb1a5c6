"""Configuration of traffic: amount and behaviour, with names of CARLA's Traffic Manager."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from carlaloc_env.core import clock
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.map.config import SignalTiming
from carlaloc_env.traffic.tables.vehicle_state import DriverParameters

if TYPE_CHECKING:
    from carlaloc_env.town.town import Town


LEVELS = {"dynamic": 1.0, "static": 0.0, "empty": 0.0}
"""Named levels of traffic, as fractions of the town's numbers; `empty` leaves out parked cars, too."""
_HOUR_S = 3600.0
"""A drive without a green wave begins at any second of an hour [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficConfig:
    """Amount of traffic, its behaviour, and its seed."""

    vehicles: int = 50
    """Number of vehicles."""
    walkers: int = 10
    """Number of walkers."""
    seed: int = 0
    """Seed of positions, models, drivers and turns; CARLA's ``set_random_device_seed``."""
    parked_cars: bool = True
    """Whether cars are parked in the town."""
    warm_up_s: float = 10.0
    """Time that traffic runs before the drive begins [s]."""
    timing: SignalTiming = field(default_factory=SignalTiming)
    """Durations of the signal phases."""
    global_percentage_speed_difference: float = 0.0
    """How much slower than usual all vehicles drive [%]; negative values drive faster."""
    distance_to_leading_vehicle: float | None = None
    """Gap that all vehicles keep to a standing vehicle in front [m]; None: the gap of each driver."""
    auto_lane_change: bool = True
    """Whether drivers change lanes to drive faster; they always do where their path asks for it."""
    random_left_lanechange_percentage: float = 0.0
    """Chance in every two seconds that a driver changes to the left for no reason [%]."""
    random_right_lanechange_percentage: float = 0.0
    """Chance in every two seconds that a driver changes to the right for no reason [%]."""
    keep_right_rule_percentage: float = 20.0
    """Percentage of drivers who prefer the lane at the kerb, the left one in left-hand traffic [%]."""
    ignore_lights_percentage: float = 0.0
    """Chance that a driver takes no notice of the lights of a junction [%]."""
    ignore_signs_percentage: float = 0.0
    """Chance that a driver does not stop at the stop signs of a junction [%]."""
    ignore_walkers_percentage: float = 0.0
    """Chance that a driver takes no notice of walkers on crosswalks, drawn every ten seconds [%]."""
    ignore_vehicles_percentage: float = 0.0
    """Chance that a driver takes no notice of the vehicle in front, drawn every second [%]."""

    def __post_init__(self) -> None:
        if self.vehicles < 0 or self.walkers < 0 or self.warm_up_s < 0:
            raise ConfigError("traffic: vehicles, walkers and warm_up_s must not be negative")
        if self.seed < 0:
            raise ConfigError(f"the seed is {self.seed}; give a whole number of 0 or more")
        for item in fields(self):
            if item.name.endswith("_percentage") and not 0.0 <= getattr(self, item.name) <= 100.0:
                raise ConfigError(f"traffic: {item.name} is {getattr(self, item.name)}; give 0 to 100")
        if not -100.0 <= self.global_percentage_speed_difference < 100.0:
            raise ConfigError("traffic: global_percentage_speed_difference must lie between -100 and 100")
        if self.distance_to_leading_vehicle is not None and not 0.5 <= self.distance_to_leading_vehicle <= 50:
            raise ConfigError("traffic: distance_to_leading_vehicle must lie between 0.5 and 50 m")

    def driver_parameters(self) -> DriverParameters:
        """Parameters of all drivers, as compiled functions read them."""
        return DriverParameters(
            seed=self.seed,
            auto_lane_change=self.auto_lane_change,
            random_left=0.01 * self.random_left_lanechange_percentage,
            random_right=0.01 * self.random_right_lanechange_percentage,
            ignore_lights=0.01 * self.ignore_lights_percentage,
            ignore_signs=0.01 * self.ignore_signs_percentage,
            ignore_walkers=0.01 * self.ignore_walkers_percentage,
            ignore_vehicles=0.01 * self.ignore_vehicles_percentage,
        )


_OPTIONS = (
    *(item.name for item in fields(TrafficConfig) if item.name not in ("seed", "timing")), "green_wave"
)  # fmt: skip
"""Options of traffic that users may give beside its level."""


def traffic_of_town(town: Town, level: str | float | Mapping[str, Any], seed: int) -> TrafficConfig:
    """Traffic of a town at a level.

    Args:
        town: The town; its town.toml counts vehicles and walkers, or the map has room for so many.
        level: ``dynamic`` (all of it), ``static`` (none but parked cars), ``empty`` (not even these) or a
            fraction, e.g. ``0.5``; followed, if wanted, by options of `TrafficConfig`:
            ``"dynamic,ignore_lights_percentage=20"``. Or a mapping with those options and ``level``.
        seed: Seed of the traffic.

    Raises:
        ConfigError: neither a known word nor a number ≥ 0, or an option that is unknown or wrong.
    """
    options = _options_of(level)
    level = options.pop("level", "dynamic")
    fraction = _fraction(level)
    for name in options:
        if name not in _OPTIONS:
            raise ConfigError(unknown_name("traffic option", name, _OPTIONS))
    vehicles, walkers = town.config.traffic.vehicles, town.config.traffic.walkers
    if vehicles is None or walkers is None:
        # Here, since what builds towns takes half a second to import, and a town's file names its numbers.
        from carlaloc_env.map.traffic_counts import traffic_counts

        vehicles, walkers = traffic_counts(town.network, town.config.traffic)
    timing = town.config.signals
    timing = replace(timing, green_wave=bool(options.pop("green_wave", timing.green_wave)))
    if not timing.green_wave:
        begins_s = _HOUR_S * float(clock.stream(seed, "traffic/lights").uniform())
        timing = replace(timing, offset_s=timing.offset_s + begins_s)
    settings: dict[str, Any] = {
        "vehicles": round(fraction * vehicles),
        "walkers": round(fraction * walkers),
        "seed": seed,
        "parked_cars": level != "empty",
        "timing": timing,
    }
    return TrafficConfig(**(settings | options))


def _fraction(level: object) -> float:
    try:
        fraction = LEVELS[level] if isinstance(level, str) and level in LEVELS else float(str(level))
    except ValueError:
        fraction = -1.0
    if not 0.0 <= fraction <= 10.0:
        raise ConfigError(unknown_name("traffic level", str(level), [*LEVELS, "a fraction such as 0.5"]))
    return fraction


def _options_of(level: str | float | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(level, Mapping):
        return dict(level)
    level, *pairs = str(level).split(",")
    options: dict[str, Any] = {"level": level}
    for pair in pairs:
        name, _, text = pair.partition("=")
        options[name.strip()] = _value(name.strip(), text.strip())
    return options


def _value(name: str, text: str) -> bool | int | float:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return int(text) if name in ("vehicles", "walkers") else float(text)
    except ValueError as error:
        raise ConfigError(f"traffic option {name}: '{text}' is no number; write e.g. {name}=20") from error
