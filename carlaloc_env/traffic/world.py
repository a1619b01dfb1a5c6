"""All other road users of a town: who they are, and where they are every 50 ms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.assets.catalog import VEHICLES, WALKERS, Tints
from carlaloc_env.clock import STEP_NS
from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.scene import EGO_INSTANCE
from carlaloc_env.semantics import Tag
from carlaloc_env.timeline import (
    LIGHT_BRAKE,
    LIGHT_LEFT,
    LIGHT_RIGHT,
    ActorCatalog,
    ActorFrame,
)
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.traffic.ego_view import EgoView
from carlaloc_env.traffic.signal_plan import SignalPlan, SignalTiming
from carlaloc_env.traffic.tables import TrafficTables
from carlaloc_env.traffic.vehicles import Drivers, Vehicles
from carlaloc_env.traffic.walkers import Walkers

if TYPE_CHECKING:
    from carlaloc_env.town.town import Town

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficConfig:
    """How much traffic there is, and its seed."""

    vehicles: int = 50
    """Number of vehicles."""
    walkers: int = 10
    """Number of walkers."""
    seed: int = 0
    """Seed of places, models, drivers and turns."""
    warm_up_s: float = 10.0
    """Time that traffic runs before the drive begins [s]."""
    timing: SignalTiming = field(default_factory=SignalTiming)
    """Durations of the signal phases."""

    def __post_init__(self) -> None:
        if self.vehicles < 0 or self.walkers < 0 or self.warm_up_s < 0:
            raise ConfigError("traffic: vehicles, walkers and warm_up_s must not be negative")


def traffic_of_town(town: Town, share: str | float, seed: int) -> TrafficConfig:
    """Configuration of a share of a town's traffic.

    Args:
        town: The town; its town.toml counts vehicles and walkers.
        share: ``dynamic`` (all of it), ``static`` (none) or a fraction, e.g. ``0.5``.
        seed: Seed of the traffic.

    Raises:
        ConfigError: neither a known word nor a number ≥ 0.
    """
    words = {"dynamic": 1.0, "static": 0.0}
    try:
        fraction = words[share] if share in words else float(share)
    except (TypeError, ValueError):
        fraction = -1.0
    if not 0.0 <= fraction <= 10.0:
        known = [*words, "a fraction such as 0.5"]
        raise ConfigError(unknown_name("traffic level", str(share), known))
    counts = town.config.traffic
    return TrafficConfig(
        vehicles=round(fraction * counts.vehicles),
        walkers=round(fraction * counts.walkers),
        seed=seed,
        timing=SignalTiming(
            green_s=town.config.signals.green_s,
            yellow_s=town.config.signals.yellow_s,
            all_red_s=town.config.signals.all_red_s,
            offset_s=town.config.signals.offset_s,
        ),
    )


class TrafficWorld:
    """Vehicles, walkers and signals of one town.

    `reset` puts everybody in place; each `step` moves them by 50 ms and returns their state.
    """

    def __init__(
        self, network: LaneNetwork, config: TrafficConfig, tables: TrafficTables | None = None
    ) -> None:
        self._network = network
        self._config = config
        self.signal_plan = SignalPlan.from_network(network, config.timing)
        names, tints = _draw_fleet(config)
        self._tables = tables or TrafficTables(network)
        self._vehicles = Vehicles(network, self._tables, _draw_drivers(names, config.seed), config.seed)
        self.catalog = _catalog(names, tints, config)

    def reset(self, ego: EgoView | None = None) -> ActorFrame:
        """Everybody's state at time 0, after the warm-up.

        Raises:
            ConfigError: the vehicles or walkers do not fit on the map.
        """
        config = self._config
        keep_clear = np.array([ego.position_m]) if ego is not None else np.zeros((0, 3))
        lane, station = self._tables.starting_places(config.seed, keep_clear)
        if len(lane) < config.vehicles:
            raise ConfigError(f"{config.vehicles} vehicles do not fit on this map; at most {len(lane)} do")
        self._vehicles.place(lane[: config.vehicles], station[: config.vehicles])
        self._walkers = Walkers(self._network, config.walkers, config.seed)
        self._step = -round(config.warm_up_s * 1e9) // STEP_NS
        watched = ego or EgoView(position_m=(1e6, 1e6, 0.0), heading_rad=0.0, speed_mps=0.0)
        while self._step < 0:
            self._advance(watched)
        self._vehicles.travelled_m[:] = 0.0
        self._walkers.travelled_m[:] = 0.0
        return self._frame()

    def step(self, ego: EgoView) -> ActorFrame:
        """Everybody's state 50 ms later, having seen the ego where it is now."""
        self._advance(ego)
        return self._frame()

    def signals(self, stamp_ns: int) -> NDArray[np.uint8]:
        """`SignalState` of every head at a time [ns]."""
        return self.signal_plan.state_at(stamp_ns)

    def _advance(self, ego: EgoView) -> None:
        self._vehicles.step(ego, self.signal_plan.state_at(self._step * STEP_NS))
        self._walkers.step()
        self._step += 1

    def _frame(self) -> ActorFrame:
        v, w = self._vehicles, self._walkers
        position, heading, pitch = v.poses()
        walker_position, walker_heading, walker_pitch = w.poses()
        turn = v.turn_ahead()
        lights = (
            np.where((v.acceleration_mps2 < -0.6) | (v.speed_mps < 0.1), LIGHT_BRAKE, 0)
            | np.where(turn > 0.5, LIGHT_LEFT, 0)
            | np.where(turn < -0.5, LIGHT_RIGHT, 0)
        )
        none = np.zeros(len(walker_heading))

        def f32(vehicles: Array, walkers: Array) -> NDArray[np.float32]:
            return np.concatenate([vehicles, walkers]).astype(np.float32)

        return ActorFrame(
            position_m=f32(position, walker_position),
            heading_rad=f32(heading, walker_heading),
            pitch_rad=f32(pitch, walker_pitch),
            speed_mps=f32(v.speed_mps, w.speed_mps),
            travelled_m=f32(v.travelled_m, w.travelled_m),
            steer_rad=f32(np.zeros(len(heading)), none),
            lights=np.concatenate([lights, none]).astype(np.uint8),
        )


def _draw_fleet(config: TrafficConfig) -> tuple[list[str], NDArray[np.uint8]]:
    draw = rng.stream(config.seed, "traffic/fleet")
    names = _draw_names(draw, {name: model.weight for name, model in VEHICLES.items()}, config.vehicles)
    return names, np.array([_draw_tint(draw, VEHICLES[name].tints) for name in names], np.uint8)


def _draw_names(draw: np.random.Generator, weights: Mapping[str, float], count: int) -> list[str]:
    share = np.array(list(weights.values()))
    names = list(weights)
    return [names[k] for k in draw.choice(len(names), size=count, p=share / share.sum())]


def _draw_tint(draw: np.random.Generator, tints: Tints) -> tuple[int, int, int]:
    share = np.array([weight for _, weight in tints])
    return tints[int(draw.choice(len(tints), p=share / share.sum()))][0]


def _draw_drivers(names: list[str], seed: int) -> Drivers:
    """Drivers' habits: town values of Treiber & Kesting, "Traffic Flow Dynamics", ch. 11."""
    draw = rng.stream(seed, "traffic/drivers")
    count = len(names)
    models = [VEHICLES[name] for name in names]
    heavy = np.array([model.tag in (Tag.TRUCK, Tag.BUS) for model in models], dtype=bool)
    return Drivers(
        length_m=np.array([model.length_m for model in models]),
        wheelbase_m=np.array([model.wheelbase_m for model in models]),
        speed_factor=np.clip(draw.normal(1.0, 0.1, count), 0.8, 1.2) * np.where(heavy, 0.9, 1.0),
        headway_s=np.where(heavy, 1.6, np.clip(draw.normal(1.2, 0.25, count), 0.8, 2.0)),
        standstill_m=np.where(heavy, 3.0, draw.uniform(2.0, 2.5, count)),
        acceleration_mps2=np.where(heavy, 1.0, draw.uniform(1.2, 1.8, count)),
        braking_mps2=np.where(heavy, 1.5, 2.0),
    )


def _catalog(names: list[str], tints: NDArray[np.uint8], config: TrafficConfig) -> ActorCatalog:
    draw = rng.stream(config.seed, "traffic/people")
    who = _draw_names(draw, {name: model.weight for name, model in WALKERS.items()}, config.walkers)
    clothes = np.array([_draw_tint(draw, WALKERS[name].tints) for name in who], np.uint8)
    size = [VEHICLES[name].size_m for name in names] + [WALKERS[name].size_m for name in who]
    tags = [int(VEHICLES[name].tag) for name in names] + [int(Tag.PEDESTRIAN)] * len(who)
    return ActorCatalog(
        id=np.arange(EGO_INSTANCE + 1, EGO_INSTANCE + 1 + len(tags), dtype=np.uint32),
        model=tuple(names + who),
        tag=np.array(tags, np.uint8),
        size_m=np.array(size, np.float32).reshape(-1, 3),
        tint=np.concatenate([tints.reshape(-1, 3), clothes.reshape(-1, 3)]).astype(np.uint8),
    )
