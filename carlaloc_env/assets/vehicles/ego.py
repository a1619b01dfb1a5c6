"""The ego's own body: a dark grey electric saloon in the `base_link` frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from carlaloc_env.assets.catalog import EGO_TINT
from carlaloc_env.assets.modelling.primitives import placed
from carlaloc_env.assets.vehicles.body import BodyShape
from carlaloc_env.assets.vehicles.car_spec import CarSpec
from carlaloc_env.assets.vehicles.cars import car
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_REAR_M, EGO_SIZE_M, EGO_WHEELBASE_M
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh

EGO_SPEC = CarSpec(
    shape=BodyShape(
        length_m=EGO_SIZE_M[0], width_m=EGO_SIZE_M[1],
        top=((0.0, 0.64), (0.08, 0.70), (0.45, 0.80), (0.95, 0.90), (1.28, 0.955), (2.20, 1.38), (2.65, 1.45),
             (3.10, 1.43), (3.42, 1.37), (4.28, 1.04), (4.62, 1.01), (4.70, 0.96)),
        belt=((0.0, 0.60), (0.5, 0.69), (1.0, 0.78), (1.3, 0.85), (2.0, 0.90), (4.0, 0.96), (4.7, 0.96)),
        cowl_d=1.28, roof_front_d=2.20, roof_rear_d=3.42, deck_d=4.28,
        windows=((1.44, 2.46), (2.54, 3.40), (3.45, 3.84)),
        axles_d=(EGO_FRONT_M - EGO_WHEELBASE_M, EGO_FRONT_M), tyre_m=0.67, clearance_m=0.14, nose_bow_m=0.30,
        tail_bow_m=0.14,
    ),
    tyre_width_m=0.235, spokes=10, bars=0,
    head=((0.56, 0.60), (0.80, 0.58), (0.965, 0.64), (0.965, 0.74), (0.58, 0.67)),
    grille=(0.30, 0.32, 0.56, 0.60), intake=(0.66, 0.62, 0.22, 0.38),
    tail=((0.50, 0.78), (0.96, 0.76), (0.97, 0.92), (0.52, 0.88)), plate_z=(0.46, 0.66),
    doors=(1.40, 2.50, 3.42),
)  # fmt: skip
"""The ego's car, a saloon."""


def ego_body() -> Mesh:
    """Body of the ego: origin on the ground below the rear axle, x ahead, −0.95 m … 3.75 m."""
    body = placed(car(EGO_SPEC).whole, (EGO_REAR_M + 0.5 * EGO_SIZE_M[0], 0.0, 0.0))
    painted = body.material == Material.CAR_PAINT
    # Its lenses would glow at the lower edge of its own cameras' pictures.
    lens = body.material == Material.LAMP_WHITE
    return replace(
        body,
        # Matt, so that the bonnet stays dark under a bright sky.
        material=np.where(
            painted, Material.METAL_PAINTED, np.where(lens, Material.PLASTIC, body.material)
        ).astype(np.uint8),
        colour=np.where(painted[:, None], np.array(EGO_TINT), body.colour).astype(np.uint8),
    )
