"""Vehicles and walkers of the catalogue: names, sizes, colours, and how often each is seen."""

from dataclasses import dataclass

from carlaloc_env.core.ego import EGO_SIZE_M, EGO_WHEELBASE_M
from carlaloc_env.scene.mesh import Colour
from carlaloc_env.scene.semantic_tags import Tag

Tints = tuple[tuple[Colour, float], ...]
"""Linear tints with their fractions of a fleet."""
FLEET_TINTS: Tints = (
    ((232, 232, 226), 0.30),
    ((9, 9, 10), 0.20),
    ((46, 48, 51), 0.18),
    ((142, 144, 146), 0.12),
    ((8, 24, 88), 0.09),
    ((104, 6, 8), 0.06),
    ((12, 52, 26), 0.02),
    ((138, 118, 84), 0.02),
    ((190, 60, 6), 0.01),
)
"""Linear paint colours with their share of the fleet: white, black, grey, silver, blue, red, other."""
CARGO_TINTS: Tints = (
    ((232, 232, 226), 0.7),
    ((142, 144, 146), 0.15),
    ((8, 24, 88), 0.1),
    ((190, 130, 6), 0.05),
)
"""Tints of trucks and vans."""
BUS_TINTS: Tints = (((150, 8, 10), 0.4), ((10, 50, 120), 0.3), ((225, 225, 220), 0.3))
"""Tints of buses."""
CYCLE_TINTS: Tints = (((9, 9, 10), 0.4), ((104, 6, 8), 0.2), ((8, 24, 88), 0.2), ((190, 190, 190), 0.2))
"""Tints of bicycles and motorcycles."""
CLOTH_TINTS: Tints = (
    ((14, 16, 26), 0.22),
    ((40, 42, 46), 0.16),
    ((190, 188, 180), 0.14),
    ((20, 42, 96), 0.14),
    ((120, 16, 18), 0.10),
    ((30, 60, 34), 0.08),
    ((140, 112, 70), 0.08),
    ((200, 150, 24), 0.04),
    ((92, 40, 96), 0.04),
)
"""Linear colours of a walker's upper clothes with their shares."""
GAIT_PHASES = 48
"""Number of postures in which a stride is stored."""
LOW_GAIT_PHASES = 16
"""The same for walkers far away."""
EGO_TINT: Colour = (10, 11, 12)
"""Linear tint of the ego's dark grey paint."""


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """A vehicle that can take part in traffic; its mesh stands centred on its box, nose along +x."""

    name: str
    tag: Tag
    size_m: tuple[float, float, float]
    """Length, width, height [m]."""
    wheelbase_m: float
    weight: float
    """Share of the fleet; all weights add up to 1."""
    tints: Tints = FLEET_TINTS
    """Linear colours 0–255 with their shares."""


@dataclass(frozen=True, slots=True)
class WalkerModel:
    """A person on foot."""

    name: str
    stature_m: float
    stride_m: float
    """Distance of one whole gait cycle (two steps) [m]; drives the phase, so that feet do not slide."""
    speed_mps: float
    """Usual walking speed [m/s]."""
    depth_m: float
    width_m: float
    weight: float
    """Share of the walkers; all weights add up to 1."""
    tints: Tints = CLOTH_TINTS
    """Linear colours 0–255 of the upper clothes with their shares."""

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length (along the walk, at full stride), width, height [m]; 3 cm for hat and hair."""
        return self.depth_m, self.width_m, self.stature_m + 0.03


_VEHICLES = (
    VehicleModel("city_car", Tag.CAR, (3.60, 1.65, 1.50), 2.40, 0.07),
    VehicleModel("hatchback", Tag.CAR, (4.28, 1.79, 1.46), 2.63, 0.20),
    VehicleModel("saloon", Tag.CAR, (4.70, 1.85, 1.45), 2.82, 0.19),
    VehicleModel("estate", Tag.CAR, (4.75, 1.85, 1.48), 2.82, 0.08),
    VehicleModel("coupe", Tag.CAR, (4.50, 1.88, 1.32), 2.50, 0.03),
    VehicleModel("suv", Tag.CAR, (4.45, 1.85, 1.65), 2.66, 0.15),
    VehicleModel("large_suv", Tag.CAR, (4.95, 1.98, 1.78), 2.95, 0.06),
    VehicleModel("minibus", Tag.CAR, (5.00, 1.95, 1.95), 3.10, 0.03),
    VehicleModel("pickup", Tag.TRUCK, (5.60, 2.00, 1.90), 3.45, 0.05),
    VehicleModel("van", Tag.TRUCK, (5.95, 2.05, 2.55), 3.60, 0.05, CARGO_TINTS),
    VehicleModel("lorry", Tag.TRUCK, (8.00, 2.50, 3.40), 4.50, 0.03, CARGO_TINTS),
    VehicleModel("bus", Tag.BUS, (12.00, 2.55, 3.10), 5.90, 0.02, BUS_TINTS),
    VehicleModel("motorcycle", Tag.MOTORCYCLE, (2.15, 0.80, 1.65), 1.45, 0.02, CYCLE_TINTS),
    VehicleModel("bicycle", Tag.BICYCLE, (1.75, 0.60, 1.75), 1.05, 0.02, CYCLE_TINTS),
)
VEHICLES = {model.name: model for model in _VEHICLES}
"""All vehicles of the traffic by name."""
EGO_MODEL = VehicleModel("electric_saloon", Tag.CAR, EGO_SIZE_M, EGO_WHEELBASE_M, 0.0)
"""The ego's model, as other cars see it."""
ALL_VEHICLES = {**VEHICLES, EGO_MODEL.name: EGO_MODEL}
"""Vehicles of the traffic, and cars with physics of their own."""
_WALKERS = (
    WalkerModel("walker_man", 1.76, 1.46, 1.38, 1.14, 0.60, 0.15),
    WalkerModel("walker_man_suit", 1.80, 1.50, 1.42, 1.16, 0.71, 0.10),
    WalkerModel("walker_man_stout", 1.74, 1.38, 1.28, 1.10, 0.60, 0.08),
    WalkerModel("walker_youth", 1.70, 1.44, 1.42, 1.10, 0.58, 0.11),
    WalkerModel("walker_woman", 1.63, 1.34, 1.33, 1.04, 0.56, 0.15),
    WalkerModel("walker_woman_skirt", 1.66, 1.34, 1.33, 1.06, 0.56, 0.11),
    WalkerModel("walker_woman_coat", 1.65, 1.32, 1.30, 1.04, 0.64, 0.10),
    WalkerModel("walker_elderly", 1.68, 1.08, 1.00, 1.10, 0.60, 0.07),
    WalkerModel("walker_elderly_woman", 1.58, 1.00, 0.95, 0.88, 0.56, 0.05),
    WalkerModel("walker_child", 1.28, 1.06, 1.20, 0.82, 0.46, 0.05),
    WalkerModel("walker_girl", 1.18, 0.98, 1.15, 0.78, 0.42, 0.03),
)
WALKERS = {model.name: model for model in _WALKERS}
"""All walkers by name."""
