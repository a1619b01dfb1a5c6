"""All other road users of a town: who they are, and where they are every 50 ms."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.clock import STEP_NS
from carlaloc_env.errors import ConfigError
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
from carlaloc_env.traffic.signal_plan import SignalPlan, SignalTiming
from carlaloc_env.traffic.vehicles import Drivers, EgoView, Vehicles, spread_over_lanes
from carlaloc_env.traffic.walkers import Walkers

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


class TrafficWorld:
    """Vehicles, walkers and signals of one town.

    `reset` puts everybody in place; each `step` moves them by 50 ms and returns their state.
    """

    def __init__(self, network: LaneNetwork, config: TrafficConfig) -> None:
        self._network = network
        self._config = config
        self.signal_plan = SignalPlan.from_network(network, config.timing)
        names, tints = _draw_fleet(config)
        self._vehicles = Vehicles(network, _draw_drivers(names, config.seed), config.seed)
        self.catalog = _catalog(names, tints, config)

    def reset(self, ego: EgoView | None = None) -> ActorFrame:
        """Everybody's state at time 0, after the warm-up.

        Raises:
            ConfigError: the vehicles or walkers do not fit on the map.
        """
        config = self._config
        keep_clear = np.array([ego.position_m]) if ego is not None else np.zeros((0, 3))
        length = [lane.length_m for lane in self._network.lanes]
        lane, station = spread_over_lanes(self._vehicles, length, config.seed, keep_clear)
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
    names = list(VEHICLES)
    weight = np.array([VEHICLES[name].weight for name in names])
    chosen = [names[k] for k in draw.choice(len(names), size=config.vehicles, p=weight / weight.sum())]
    tints = [VEHICLES[name].tints[int(draw.integers(len(VEHICLES[name].tints)))] for name in chosen]
    return chosen, np.array(tints, np.uint8).reshape(-1, 3)


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
    people = list(WALKERS)
    who = [people[int(k)] for k in draw.integers(len(people), size=config.walkers)]
    clothes = draw.integers(20, 200, size=(config.walkers, 3)).astype(np.uint8)
    size = [(VEHICLES[n].length_m, VEHICLES[n].width_m, VEHICLES[n].height_m) for n in names]
    size += [(WALKERS[n].length_m, WALKERS[n].width_m, WALKERS[n].height_m) for n in who]
    tags = [int(VEHICLES[n].tag) for n in names] + [int(Tag.PEDESTRIAN)] * len(who)
    count = len(names) + len(who)
    return ActorCatalog(
        id=np.arange(EGO_INSTANCE + 1, EGO_INSTANCE + 1 + count, dtype=np.uint32),
        model=tuple(names + who),
        tag=np.array(tags, np.uint8),
        size_m=np.array(size, np.float32).reshape(-1, 3),
        tint=np.concatenate([tints, clothes]).reshape(-1, 3),
    )
