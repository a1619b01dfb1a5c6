"""Population of the traffic: models, colours and drivers drawn from the catalogue.

How much traffic there is and how it behaves; names after CARLA's Traffic Manager where it has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.catalog import VEHICLES, WALKERS, Tints
from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_WHEELBASE_M
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.map.config import SignalTiming
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.timeline import ActorCatalog
from carlaloc_env.traffic.tables.record_arrays import fill
from carlaloc_env.traffic.tables.vehicle_state import DriverParameters, Drivers
from carlaloc_env.traffic.vehicles.ego_agent import EgoView

if TYPE_CHECKING:
    from carlaloc_env.town.town import Town

LEVELS = {"dynamic": 1.0, "static": 0.0, "empty": 0.0}
"""Named levels of traffic, as fractions of the town's numbers; `empty` leaves out parked cars, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficConfig:
    """How much traffic there is, how it behaves, and its seed."""

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
_HOUR_S = 3600.0
"""A drive without a green wave begins at any second of an hour [s]."""


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


_HEAVY_TOP_MPS = 25.0
"""Top speed of trucks and buses [m/s]: 90 km/h."""
_CYCLIST_MPS = (15.0 / 3.6, 22.0 / 3.6)
"""Least and greatest desired speed of cyclists [m/s]: 15 to 22 km/h."""
_CYCLE_EDGE_M = 0.75
"""Distance of cyclists from the edge of their lane at the kerb [m]."""


def draw_vehicles(config: TrafficConfig) -> tuple[list[str], NDArray[np.uint8]]:
    """Model names of all vehicles and their colours (N, 3)."""
    draw = clock.stream(config.seed, "traffic/fleet")
    names = draw_names(draw, {name: model.weight for name, model in VEHICLES.items()}, config.vehicles)
    return names, np.array([draw_tint(draw, VEHICLES[name].tints) for name in names], np.uint8)


def draw_drivers(names: list[str], config: TrafficConfig) -> Drivers:
    """Drivers of N vehicles, the ego in the last row, (N + 1,).

    Headways as in towns (Treiber & Kesting, "Traffic Flow Dynamics", ch. 11); accelerations up to those of
    SUMO's vehicle classes.
    """
    draw = clock.stream(config.seed, "traffic/drivers")
    count = len(names)
    models = [VEHICLES[name] for name in names]
    tag = np.array([int(model.tag) for model in models], dtype=np.int64)
    heavy = np.isin(tag, (int(Tag.TRUCK), int(Tag.BUS))) & np.array([m.size_m[0] > 6.5 for m in models], bool)
    motorcycle, bicycle = tag == int(Tag.MOTORCYCLE), tag == int(Tag.BICYCLE)
    two_wheels = motorcycle | bicycle
    factor = np.clip(draw.normal(1.0, 0.1, count), 0.8, 1.2)
    headway = np.clip(draw.normal(1.1, 0.2, count), 0.8, 1.8)
    standstill = draw.uniform(2.0, 2.5, count)
    acceleration = draw.uniform(1.8, 2.6, count)
    change_s = np.clip(draw.normal(4.6, 0.8, count), 3.0, 7.0)
    cyclist = draw.uniform(*_CYCLIST_MPS, count)
    keeps_to_kerb = draw.random(count) < 0.01 * config.keep_right_rule_percentage
    slower = 1.0 - 0.01 * config.global_percentage_speed_difference
    distance = config.distance_to_leading_vehicle
    ego = EgoView(position_m=(0.0, 0.0, 0.0), heading_rad=0.0, speed_mps=0.0)

    def with_ego(values: Array, of_ego: float) -> Array:
        return np.append(values.astype(np.float64), of_ego)

    return fill(
        Drivers,
        count + 1,
        length_m=with_ego(np.array([model.size_m[0] for model in models]), ego.length_m),
        width_m=with_ego(np.array([model.size_m[1] for model in models]), ego.width_m),
        wheelbase_m=with_ego(np.array([model.wheelbase_m for model in models]), EGO_WHEELBASE_M),
        speed_factor=with_ego(factor * slower * np.where(heavy, 0.9, 1.0), 1.0),
        top_mps=with_ego(np.where(bicycle, cyclist * slower, np.where(heavy, _HEAVY_TOP_MPS, 70.0)), 70.0),
        headway_s=with_ego(np.where(heavy, 1.6, np.where(two_wheels, 1.1, headway)), 1.2),
        standstill_m=with_ego(
            np.where(heavy, 3.0, np.where(two_wheels, 1.5, standstill))
            if distance is None
            else np.full(count, distance),
            2.0,
        ),
        acceleration_mps2=with_ego(
            np.where(heavy | bicycle, 1.2, np.where(motorcycle, 2.6, acceleration)), 1.5
        ),
        braking_mps2=with_ego(np.where(heavy | bicycle, 1.5, np.where(motorcycle, 2.5, 2.0)), 2.0),
        change_s=with_ego(np.where(two_wheels, 3.0, change_s), 4.0),
        keeps_to_kerb=with_ego(np.where(keeps_to_kerb | bicycle, 0.2, 0.0), 0.0),
        edge_distance_m=with_ego(np.where(bicycle, _CYCLE_EDGE_M, 0.0), 0.0),
    )


def draw_catalog(names: list[str], tints: NDArray[np.uint8], config: TrafficConfig) -> ActorCatalog:
    """All vehicles, then all walkers."""
    draw = clock.stream(config.seed, "traffic/people")
    walker_models = draw_names(draw, {name: model.weight for name, model in WALKERS.items()}, config.walkers)
    clothes = np.array([draw_tint(draw, WALKERS[name].tints) for name in walker_models], np.uint8)
    return catalog_of(names, walker_models, np.concatenate([tints.reshape(-1, 3), clothes.reshape(-1, 3)]))


def catalog_of(vehicles: list[str], walkers: list[str], tints: NDArray[np.uint8]) -> ActorCatalog:
    """All vehicles, then all walkers, by the names of their models and their colours (N, 3)."""
    size = [VEHICLES[name].size_m for name in vehicles] + [WALKERS[name].size_m for name in walkers]
    tags = [int(VEHICLES[name].tag) for name in vehicles] + [int(Tag.PEDESTRIAN)] * len(walkers)
    return ActorCatalog(
        id=np.arange(EGO_INSTANCE + 1, EGO_INSTANCE + 1 + len(tags), dtype=np.uint32),
        model=(*vehicles, *walkers),
        tag=np.array(tags, np.uint8),
        size_m=np.array(size, np.float32).reshape(-1, 3),
        tint=tints,
    )


def draw_names(draw: np.random.Generator, weights: Mapping[str, float], count: int) -> list[str]:
    """Names of `count` models, each as often as its weight has it."""
    probability = np.array(list(weights.values()))
    names = list(weights)
    return [names[k] for k in draw.choice(len(names), size=count, p=probability / probability.sum())]


def draw_tint(draw: np.random.Generator, tints: Tints) -> tuple[int, int, int]:
    """Colour of one actor, sRGB."""
    probability = np.array([weight for _, weight in tints])
    return tints[int(draw.choice(len(tints), p=probability / probability.sum()))][0]
