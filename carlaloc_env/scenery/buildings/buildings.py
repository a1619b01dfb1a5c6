"""Buildings: masses with four facades, a roof and what stands on it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh
from carlaloc_env.scenery.buildings.facades import facade
from carlaloc_env.scenery.buildings.roofs import add_roof
from carlaloc_env.scenery.buildings.shell import GARAGE_DOOR, Appearance, Shell
from carlaloc_env.scenery.buildings.styles import STYLES, ZONE_STYLES, Style
from carlaloc_env.scenery.buildings.walls import Wall, around
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder

FOUNDATION_M = 1.2
"""How far walls reach below their ground level, so that no gap opens on sloping ground [m]."""
_SIGNS: tuple[Colour, ...] = (
    (150, 20, 18), (16, 40, 95), (14, 80, 45), (200, 150, 20), (30, 30, 32), (110, 20, 60), (220, 220, 210),
    (20, 90, 110), (190, 80, 15),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildingPlan:
    """Measures of one building."""

    appearance: Appearance
    """Style, material and tints."""
    width_m: float
    """Length of the front [m]."""
    depth_m: float
    """Distance from front to back [m]."""
    storeys: int
    """Number of storeys."""

    @property
    def height_m(self) -> float:
        """Height of the walls above the ground [m]."""
        style = self.appearance.style
        return style.ground_m + (self.storeys - 1) * style.storey_m

    def levels_m(self) -> Array:
        """Heights of the storeys' lower edges and of the top [m], shape (storeys + 1,)."""
        style = self.appearance.style
        return np.concatenate([[0.0], style.ground_m + style.storey_m * np.arange(self.storeys)])


def draw_plan(
    zone: str, rng: np.random.Generator, before: Sequence[Appearance], widest_m: float = 60.0
) -> BuildingPlan | None:
    """Choose a building for a zone that resembles none of those `before`; None where the zone has none.

    Args:
        zone: Kind of scenery.
        rng: Randomness of this lot.
        before: Appearances of the neighbours.
        widest_m: Longest front that fits [m].
    """
    entries = [(name, w) for name, w in ZONE_STYLES[zone] if STYLES[name].width_m[0] <= widest_m]
    if not entries:
        return None
    weights = np.array([weight for _, weight in entries])
    for _ in range(12):
        style = STYLES[entries[int(rng.choice(len(entries), p=weights / weights.sum()))][0]]
        appearance = draw_appearance(style, rng)
        if all((appearance.material, appearance.tint) != (other.material, other.tint) for other in before):
            break
    width = float(rng.uniform(style.width_m[0], min(style.width_m[1], widest_m)))
    return BuildingPlan(
        appearance=appearance,
        width_m=round(width, 2),
        depth_m=round(float(rng.uniform(*style.depth_m)), 2),
        storeys=int(rng.integers(style.storeys[0], style.storeys[1] + 1)),
    )


def building_mesh(plan: BuildingPlan, rng: np.random.Generator, instance: int) -> Mesh:
    """A building on z = 0 whose front foot runs from (0, 0) to (width, 0) and looks towards −y."""
    shell, levels = Shell(out=MeshBuilder(), look=plan.appearance), plan.levels_m()
    for index, (x, y, width, depth, first, last) in enumerate(_masses(plan)):
        base = float(levels[first])
        heights = levels[first : last + 1] - base
        for side, wall in enumerate(around(width, depth)):
            _one_wall(shell, wall.moved((x, y, base)), heights, rng, street=side == 0 and index == 0)
        add_roof(shell, (x, y, width, depth), float(levels[last]), rng, last == plan.storeys)
    if shell.look.style.ground == "hall":
        _hall_doors(shell, plan, rng)
    for wall in around(plan.width_m, plan.depth_m):
        shell.trim(wall.front(0.0, wall.width_m, -FOUNDATION_M, 0.0, 0.02))
    return shell.out.build().with_instance(instance)


def draw_appearance(style: Style, rng: np.random.Generator) -> Appearance:
    """Choose material and tints of a building."""
    material, tint = style.walls[int(rng.integers(len(style.walls)))]
    shade = float(rng.uniform(0.86, 1.0))
    return Appearance(
        style=style,
        material=material,
        tint=(int(tint[0] * shade), int(tint[1] * shade), int(tint[2] * shade)),
        trim=style.trims[int(rng.integers(len(style.trims)))],
        sign=_SIGNS[int(rng.integers(len(_SIGNS)))],
        accent=style.accents[int(rng.integers(len(style.accents)))],
        roof=style.roofs[int(rng.integers(len(style.roofs)))],
    )


def _masses(plan: BuildingPlan) -> list[tuple[float, float, float, float, int, int]]:
    """Parts of a building: x, y, width, depth [m], first and last storey; towers stand back in steps."""
    step = plan.appearance.style.setback_storeys
    cuts = list(range(0, plan.storeys, step)) if step else [0]
    if len(cuts) > 1 and plan.storeys - cuts[-1] < step // 2:
        cuts.pop()
    parts = []
    for index, first in enumerate(cuts):
        last = cuts[index + 1] if index + 1 < len(cuts) else plan.storeys
        back = min(2.6 * index, plan.width_m * 0.3, plan.depth_m * 0.3)
        parts.append((back, back, plan.width_m - 2 * back, plan.depth_m - 2 * back, first, last))
    return parts


def _one_wall(shell: Shell, wall: Wall, levels: Array, rng: np.random.Generator, *, street: bool) -> None:
    if shell.look.material == Material.CURTAIN_WALL and not street:
        _curtain(shell, wall, levels)
    elif shell.look.material == Material.CURTAIN_WALL:
        facade(shell, wall, levels[:2], rng, front=True)
        _curtain(shell, wall.moved((0.0, 0.0, levels[1])), levels[1:] - levels[1])
    else:
        facade(shell, wall, levels, rng, front=street)


def _curtain(shell: Shell, wall: Wall, levels: Array) -> None:
    """Glass from floor to floor with mullions."""
    top = float(levels[-1])
    shell.wall(wall.front(0.0, wall.width_m, levels[:-1], levels[1:]))
    bays = max(2, round(wall.width_m / shell.look.style.bay_m))
    a = np.linspace(0.05, wall.width_m - 0.05, bays + 1)
    mullions = np.concatenate(
        [
            wall.front(a - 0.05, a + 0.05, 0.0, top, 0.14),
            wall.left_side(a - 0.05, 0.0, 0.14, 0.0, top),
            wall.right_side(a + 0.05, 0.0, 0.14, 0.0, top),
        ]
    )
    shell.trim(mullions, Material.METAL_PAINTED)
    spandrel = wall.front(0.0, wall.width_m, levels[:-1] - 0.2, levels[:-1] + 0.45, 0.04)
    shell.trim(spandrel, Material.METAL_PAINTED)


def _hall_doors(shell: Shell, plan: BuildingPlan, rng: np.random.Generator) -> None:
    """Roller doors of a hall and a small door for people."""
    wall = around(plan.width_m, plan.depth_m)[0]
    count = max(1, int(plan.width_m // 9.0))
    a = plan.width_m / count * (np.arange(count) + 0.5)
    high = min(4.2, plan.height_m - 0.8)
    gates = wall.front(a - 2.0, a + 2.0, 0.0, high, 0.02)
    frames = wall.box(a - 2.2, a + 2.2, high, high + 0.25, 0.1)
    shell.pictures(gates, Material.DOOR, np.full(count, GARAGE_DOOR))
    shell.trim(frames, Material.METAL_PAINTED)
    side = wall.front(a[0] + 2.6, a[0] + 3.5, 0.0, 2.1, 0.02)
    shell.pictures(side, Material.DOOR, rng.integers(0, GARAGE_DOOR, 1))
