"""Vehicle in parts: body, wheels, plates and lamps; turning and differing parts are drawn separately."""

from dataclasses import dataclass

import numpy as np

from carlaloc_env.assets.number_plates import PLATE_SIZE_M, plate_uv
from carlaloc_env.assets.primitives import Look, quad
from carlaloc_env.assets.texture_atlas import cell_corners
from carlaloc_env.assets.vehicles.wheels import WheelMount
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateMount:
    """Place of a number plate on a vehicle."""

    position_m: tuple[float, float, float]
    """Middle of the plate in the vehicle's frame [m]."""
    facing: float
    """+1 on the nose, −1 on the tail."""
    width_m: float = PLATE_SIZE_M[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class LampMount:
    """Place of a headlamp, which shines straight ahead."""

    position_m: tuple[float, float, float]
    """Its lens in the vehicle's frame [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleParts:
    """A vehicle centred on its box, resting on z = 0, nose along +x."""

    body: Mesh
    """All but wheels and number plates."""
    low: Mesh
    """The whole vehicle in few triangles, wheels and plates included."""
    wheels: tuple[WheelMount, ...]
    plates: tuple[PlateMount, ...]
    lamps: tuple[LampMount, ...]
    """Headlamps."""
    pedalled: tuple[tuple[Mesh, Mesh], ...] = ()
    """Body and low version for every further phase of one turn of its cranks; empty for motor vehicles."""
    crank_travel_m: float = 1.0
    """Distance on which its cranks turn once [m]."""

    @property
    def phases(self) -> int:
        """Number of postures, including that of `body`."""
        return 1 + len(self.pedalled)

    @property
    def whole(self) -> Mesh:
        """Body with its wheels straight ahead and plate 0."""
        return self.steered(0.0)

    def steered(self, steer_rad: float, phase: int = 0) -> Mesh:
        """Body with its front wheels turned to the left by an angle [rad], plate 0, cranks at a phase."""
        body = self.pedalled[phase - 1][0] if phase else self.body
        plates = [plate(mount, 0, Tag(int(self.body.tag[0]))) for mount in self.plates]
        return merge([body, *plates, *(w.mounted(steer_rad) for w in self.wheels)])


def assemble(
    *,
    body: Mesh,
    low: Mesh,
    wheels: tuple[WheelMount, ...],
    plates: tuple[PlateMount, ...],
    lamps: tuple[LampMount, ...],
) -> VehicleParts:
    """The parts, with plates added to the low version."""
    tag = Tag(int(body.tag[0]))
    far = merge([low, *(plate(mount, 0, tag) for mount in plates)])
    return VehicleParts(body=body, low=far, wheels=wheels, plates=plates, lamps=lamps)


def plate(mount: PlateMount, index: int, tag: Tag) -> Mesh:
    """Number plate with one of the texts, in the vehicle's frame."""
    x, y, z = mount.position_m
    w, h = 0.5 * mount.width_m * mount.facing, 0.5 * mount.width_m * PLATE_SIZE_M[1] / PLATE_SIZE_M[0]
    corners = np.array([(x, y - w, z - h), (x, y + w, z - h), (x, y + w, z + h), (x, y - w, z + h)])
    return quad(Look(Material.PLATE, tag), corners, cell_corners(plate_uv(index)))
