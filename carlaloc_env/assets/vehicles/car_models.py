"""The lines of every car, van and pick-up in the catalogue.

The properties in which car models differ.
"""

from dataclasses import dataclass

from carlaloc_env.assets.vehicles.body import BodyShape, Points
from carlaloc_env.scene.semantic_tags import Tag


@dataclass(frozen=True, slots=True, kw_only=True)
class CarSpec:
    """A car: its shell and the places of lamps, plates and trim; shares are of the half width."""

    shape: BodyShape
    tag: Tag = Tag.CAR
    tyre_width_m: float = 0.21
    spokes: int = 5
    head: Points = ((0.56, 0.62), (0.93, 0.60), (0.955, 0.70), (0.55, 0.69))
    """Outline of the left headlamp, (share, z)."""
    grille: tuple[float, float, float, float] = (0.50, 0.54, 0.52, 0.66)
    """Grille: half width below and above (shares), lower and upper edge z."""
    bars: int = 3
    """Bars across the grille."""
    chrome: bool = False
    """Whether grille and windows have bright frames."""
    intake: tuple[float, float, float, float] = (0.66, 0.58, 0.24, 0.38)
    """Opening in the bumper, as `grille`."""
    tail: Points = ((0.55, 0.76), (0.95, 0.74), (0.95, 0.90), (0.55, 0.88))
    """Outline of the left tail lamp, (share, z)."""
    tail_across: bool = False
    """Whether a strip joins the tail lamps."""
    plate_z: tuple[float, float] = (0.44, 0.80)
    """Height of front and rear number plate [m]."""
    doors: tuple[float, ...] = ()
    """Door gaps, distances from the nose [m]."""
    slide: bool = False
    """Whether a sliding door's rail runs along the flank."""
    barn_doors: bool = False
    """Whether the tail opens in two doors."""
    rear_window: tuple[float, float] | None = None
    """Upright rear window, heights from and to [m]."""
    rails: bool = False
    """Whether bars run along the roof."""
    exhausts: int = 1
    valance_m: float = 0.12
    """Height of the dark lower edge of nose and tail [m]."""


CARS: dict[str, CarSpec] = {
    "city_car": CarSpec(
        shape=BodyShape(
            length_m=3.60, width_m=1.65,
            top=((0.0, 0.70), (0.08, 0.78), (0.35, 0.86), (0.78, 0.95), (0.92, 0.98), (1.62, 1.42),
                 (2.1, 1.50), (2.7, 1.485), (3.28, 1.41), (3.52, 1.00), (3.60, 0.94)),
            belt=((0.0, 0.80), (0.9, 0.93), (3.2, 1.0), (3.6, 1.0)),
            cowl_d=0.92, roof_front_d=1.62, roof_rear_d=3.28, deck_d=3.52,
            windows=((1.06, 2.08), (2.16, 2.86)),
            axles_d=(0.63, 3.03), tyre_m=0.57, tail_bow_m=0.14, nose_bow_m=0.26,
        ),
        tyre_width_m=0.18, spokes=7,
        head=((0.58, 0.70), (0.70, 0.62), (0.90, 0.62), (0.965, 0.74), (0.93, 0.84), (0.64, 0.79)),
        grille=(0.36, 0.40, 0.66, 0.70), intake=(0.62, 0.66, 0.26, 0.44), bars=0,
        tail=((0.72, 0.74), (0.94, 0.70), (0.97, 0.98), (0.76, 1.00)),
        plate_z=(0.46, 0.62), doors=(1.0, 2.12),
    ),
    "hatchback": CarSpec(
        shape=BodyShape(
            length_m=4.28, width_m=1.79,
            top=((0.0, 0.68), (0.10, 0.74), (0.5, 0.82), (1.08, 0.92), (1.25, 0.95), (2.04, 1.39),
                 (2.5, 1.46), (3.1, 1.445), (3.82, 1.37), (4.18, 0.98), (4.28, 0.93)),
            belt=((0.0, 0.80), (1.1, 0.90), (3.6, 0.98), (4.28, 0.98)),
            cowl_d=1.25, roof_front_d=2.04, roof_rear_d=3.82, deck_d=4.18,
            windows=((1.40, 2.34), (2.42, 3.22), (3.28, 3.62)),
            axles_d=(0.83, 3.46), tyre_m=0.63, tail_bow_m=0.12,
        ),
        head=((0.56, 0.64), (0.80, 0.60), (0.965, 0.66), (0.97, 0.80), (0.58, 0.72)),
        grille=(0.52, 0.54, 0.60, 0.68), intake=(0.56, 0.66, 0.24, 0.44), bars=1,
        tail=((0.62, 0.76), (0.96, 0.74), (0.97, 0.96), (0.66, 0.93)),
        plate_z=(0.44, 0.62), doors=(1.34, 2.38, 3.24),
    ),
    "saloon": CarSpec(
        shape=BodyShape(
            length_m=4.70, width_m=1.85,
            top=((0.0, 0.66), (0.10, 0.71), (0.5, 0.79), (1.20, 0.90), (1.42, 0.93), (2.24, 1.37),
                 (2.75, 1.45), (3.15, 1.435), (3.45, 1.385), (4.20, 1.06), (4.60, 1.02), (4.70, 0.97)),
            belt=((0.0, 0.80), (1.2, 0.89), (4.0, 0.97), (4.7, 0.97)),
            cowl_d=1.42, roof_front_d=2.24, roof_rear_d=3.45, deck_d=4.20,
            windows=((1.56, 2.52), (2.60, 3.44), (3.49, 3.78)),
            axles_d=(0.88, 3.70), tyre_m=0.66,
        ),
        head=((0.52, 0.63), (0.70, 0.60), (0.955, 0.62), (0.965, 0.74), (0.54, 0.70)), chrome=True,
        grille=(0.40, 0.48, 0.52, 0.68), intake=(0.62, 0.56, 0.24, 0.36), bars=4,
        tail=((0.52, 0.79), (0.96, 0.77), (0.97, 0.93), (0.54, 0.90)), exhausts=2, spokes=10,
        doors=(1.50, 2.56, 3.46), plate_z=(0.42, 0.80),
    ),
    "estate": CarSpec(
        shape=BodyShape(
            length_m=4.75, width_m=1.85,
            top=((0.0, 0.66), (0.10, 0.71), (0.5, 0.79), (1.20, 0.90), (1.42, 0.93), (2.24, 1.38),
                 (2.75, 1.465), (3.4, 1.48), (4.30, 1.42), (4.58, 1.00), (4.70, 0.97), (4.75, 0.92)),
            belt=((0.0, 0.80), (1.2, 0.89), (4.0, 0.97), (4.75, 0.97)),
            cowl_d=1.42, roof_front_d=2.24, roof_rear_d=4.30, deck_d=4.58,
            windows=((1.56, 2.52), (2.60, 3.44), (3.52, 4.22)),
            axles_d=(0.88, 3.70), tyre_m=0.66, tail_bow_m=0.10,
        ),
        head=((0.54, 0.62), (0.75, 0.60), (0.96, 0.64), (0.965, 0.75), (0.55, 0.69)),
        grille=(0.44, 0.50, 0.54, 0.68), intake=(0.62, 0.56, 0.24, 0.38), bars=3, chrome=True,
        tail=((0.66, 0.74), (0.96, 0.72), (0.97, 1.02), (0.80, 1.02), (0.70, 0.92)), rails=True, spokes=7,
        plate_z=(0.42, 0.72), doors=(1.50, 2.56, 3.48),
    ),
    "coupe": CarSpec(
        shape=BodyShape(
            length_m=4.50, width_m=1.88,
            top=((0.0, 0.58), (0.10, 0.64), (0.6, 0.74), (1.30, 0.84), (1.52, 0.87), (2.36, 1.26),
                 (2.7, 1.32), (2.95, 1.30), (3.10, 1.27), (4.05, 0.94), (4.42, 0.92), (4.50, 0.87)),
            belt=((0.0, 0.72), (1.3, 0.83), (4.0, 0.92), (4.5, 0.92)),
            cowl_d=1.52, roof_front_d=2.36, roof_rear_d=3.10, deck_d=4.05,
            windows=((1.68, 2.90), (2.98, 3.40)),
            axles_d=(0.95, 3.45), tyre_m=0.68, clearance_m=0.12,
        ),
        tyre_width_m=0.25, spokes=10,
        head=((0.56, 0.54), (0.80, 0.53), (0.965, 0.60), (0.955, 0.66), (0.60, 0.60)),
        grille=(0.56, 0.46, 0.30, 0.46), intake=(0.70, 0.72, 0.17, 0.25), bars=5,
        tail=((0.40, 0.72), (0.95, 0.70), (0.97, 0.82), (0.42, 0.80)), tail_across=True, exhausts=2,
        plate_z=(0.26, 0.52), doors=(1.60, 2.96),
    ),
    "suv": CarSpec(
        shape=BodyShape(
            length_m=4.45, width_m=1.85,
            top=((0.0, 0.80), (0.08, 0.90), (0.4, 0.98), (1.05, 1.06), (1.20, 1.08), (1.96, 1.56),
                 (2.4, 1.65), (3.2, 1.64), (4.02, 1.57), (4.32, 1.10), (4.45, 1.02)),
            belt=((0.0, 0.90), (1.1, 1.03), (3.6, 1.12), (4.45, 1.12)),
            cowl_d=1.20, roof_front_d=1.96, roof_rear_d=4.02, deck_d=4.32,
            windows=((1.36, 2.34), (2.42, 3.28), (3.36, 3.84)),
            axles_d=(0.87, 3.53), tyre_m=0.70, clearance_m=0.20, cladding=True, tumblehome=0.30,
            nose_bow_m=0.18,
        ),
        tyre_width_m=0.23, valance_m=0.20,
        head=((0.58, 0.78), (0.80, 0.75), (0.965, 0.80), (0.965, 0.93), (0.60, 0.88)),
        grille=(0.50, 0.56, 0.64, 0.86), intake=(0.60, 0.54, 0.38, 0.52), bars=2,
        tail=((0.60, 0.90), (0.96, 0.86), (0.97, 1.06), (0.62, 1.02)), rails=True,
        plate_z=(0.54, 0.82), doors=(1.30, 2.38, 3.32),
    ),
    "large_suv": CarSpec(
        shape=BodyShape(
            length_m=4.95, width_m=1.98,
            top=((0.0, 0.92), (0.06, 1.02), (0.4, 1.09), (1.20, 1.14), (1.36, 1.16), (2.08, 1.68),
                 (2.5, 1.78), (3.8, 1.775), (4.66, 1.71), (4.86, 1.18), (4.95, 1.10)),
            belt=((0.0, 1.0), (1.2, 1.11), (4.0, 1.17), (4.95, 1.17)),
            cowl_d=1.36, roof_front_d=2.08, roof_rear_d=4.66, deck_d=4.86,
            windows=((1.52, 2.52), (2.61, 3.54), (3.64, 4.52)),
            axles_d=(0.92, 3.87), tyre_m=0.77, clearance_m=0.21, tumblehome=0.22, cladding=True,
            nose_bow_m=0.14, tail_bow_m=0.06,
        ),
        tyre_width_m=0.26, valance_m=0.24, spokes=6,
        head=((0.62, 0.86), (0.955, 0.84), (0.96, 1.00), (0.62, 1.00)),
        grille=(0.54, 0.56, 0.70, 1.00), intake=(0.60, 0.56, 0.42, 0.56), bars=4, chrome=True,
        tail=((0.82, 0.84), (0.97, 0.84), (0.97, 1.22), (0.84, 1.22)), rails=True,
        plate_z=(0.58, 0.88), doors=(1.46, 2.57, 3.59),
    ),
    "minibus": CarSpec(
        shape=BodyShape(
            length_m=5.00, width_m=1.95,
            top=((0.0, 0.82), (0.08, 0.94), (0.45, 1.06), (0.80, 1.13), (1.62, 1.82), (2.0, 1.93),
                 (3.0, 1.95), (4.78, 1.88), (4.96, 1.12), (5.0, 1.02)),
            belt=((0.0, 0.95), (0.8, 1.08), (5.0, 1.14)),
            cowl_d=0.80, roof_front_d=1.62, roof_rear_d=4.78, deck_d=4.96,
            windows=((1.05, 2.02), (2.12, 3.26), (3.36, 4.62)),
            axles_d=(0.92, 4.02), tyre_m=0.68, clearance_m=0.18, tumblehome=0.18, tail_bow_m=0.06,
            plan_rear=((0.0, 0.95), (0.1, 0.98), (0.5, 1.0)),
        ),
        head=((0.60, 0.78), (0.90, 0.74), (0.965, 0.84), (0.94, 1.00), (0.64, 0.92)),
        grille=(0.50, 0.56, 0.68, 0.86), intake=(0.62, 0.60, 0.30, 0.48), bars=2, valance_m=0.14,
        tail=((0.84, 0.80), (0.97, 0.80), (0.97, 1.38), (0.86, 1.38)), plate_z=(0.52, 0.78),
        doors=(1.0, 2.07, 3.31), slide=True, spokes=7,
    ),
    "pickup": CarSpec(
        tag=Tag.TRUCK,
        shape=BodyShape(
            length_m=5.60, width_m=2.00,
            top=((0.0, 0.95), (0.06, 1.06), (0.4, 1.14), (1.25, 1.19), (1.40, 1.21), (2.05, 1.79),
                 (2.4, 1.90), (3.2, 1.89), (3.62, 1.84), (3.78, 1.22), (3.85, 1.20), (5.60, 1.20)),
            belt=((0.0, 1.02), (1.2, 1.15), (5.6, 1.19)),
            cowl_d=1.40, roof_front_d=2.05, roof_rear_d=3.62, deck_d=3.78,
            windows=((1.58, 2.56), (2.64, 3.48)),
            axles_d=(0.92, 4.37), tyre_m=0.80, clearance_m=0.25, tumblehome=0.20, cladding=True,
            nose_bow_m=0.12, tail_bow_m=0.02, nose_low=0.14, bed=(3.98, 5.52, 0.94),
        ),
        tyre_width_m=0.27, valance_m=0.24, spokes=6,
        head=((0.64, 0.88), (0.955, 0.86), (0.96, 1.06), (0.64, 1.04)),
        grille=(0.58, 0.60, 0.72, 1.04), intake=(0.60, 0.56, 0.46, 0.60), bars=3, chrome=True,
        tail=((0.87, 0.80), (0.97, 0.80), (0.97, 1.14), (0.87, 1.14)),
        plate_z=(0.62, 0.60), doors=(1.52, 2.60, 3.52),
    ),
    "van": CarSpec(
        tag=Tag.TRUCK,
        shape=BodyShape(
            length_m=5.95, width_m=2.05,
            top=((0.0, 0.92), (0.06, 1.06), (0.4, 1.18), (0.72, 1.27), (1.68, 2.28), (2.2, 2.52), (3.0, 2.55),
                 (5.88, 2.53), (5.95, 2.50)),
            belt=((0.0, 1.05), (0.75, 1.20), (5.95, 1.22)),
            cowl_d=0.72, roof_front_d=1.68, roof_rear_d=5.95, deck_d=5.95,
            windows=((0.98, 1.98),),
            axles_d=(0.98, 4.58), tyre_m=0.68, clearance_m=0.19, tumblehome=0.10, tail_bow_m=0.03,
            nose_bow_m=0.20,
            cladding=True, plan_rear=((0.0, 0.96), (0.05, 0.99), (0.3, 1.0)), nose_low=0.06,
        ),
        head=((0.66, 0.86), (0.90, 0.80), (0.965, 0.92), (0.96, 1.14), (0.74, 1.08)),
        grille=(0.58, 0.52, 0.74, 0.98), intake=(0.64, 0.60, 0.36, 0.56), bars=2, valance_m=0.24,
        tail=((0.90, 0.82), (0.985, 0.82), (0.985, 1.34), (0.90, 1.34)), plate_z=(0.60, 0.72),
        doors=(0.92, 2.08, 3.38), rear_window=(1.45, 2.05), slide=True, barn_doors=True, spokes=0,
    ),
}  # fmt: skip
"""All models made by `cars.car`."""
