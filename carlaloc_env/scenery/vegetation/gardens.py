"""Front gardens: fences and low walls along the sidewalk, paths to the doors, drives, flower beds."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from carlaloc_env.assets.plants import shrub
from carlaloc_env.assets.posts_and_fences import fence, picket_panel
from carlaloc_env.assets.primitives import Look, box
from carlaloc_env.core import clock, elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.building_lots import Lot
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import PropField

LEAST_M = 2.0
"""Gardens less deep than this have no fence [m]."""
PANEL_M = 2.0
"""Length of one piece of fence or wall [m]."""
GATE_M, DRIVE_M = 0.75, 2.9
"""Half the width of a gate, and the width of a drive [m]."""
_BLOOMS = ((440, 110, 300), (447, 300, 60), (330, 170, 330), (215, 230, 185))


def wall_panel(stone: Material, tint: tuple[int, int, int]) -> Mesh:
    """Piece of a garden wall along +x from the origin, 0.75 m high, with a coping."""
    body = box(Look(stone, Tag.WALL, tint), (PANEL_M, 0.24, 1.15), (PANEL_M / 2, 0.0, 0.1))
    cope = box(
        Look(Material.CONCRETE, Tag.WALL, (235, 230, 220)), (PANEL_M, 0.32, 0.08), (PANEL_M / 2, 0, 0.715)
    )
    return merge([body, cope])


PANELS: tuple[tuple[str, Callable[[], Mesh]], ...] = (
    ("picket", partial(picket_panel, PANEL_M)),
    ("bars", partial(fence, PANEL_M, 1.0, kind="bars")),
    ("boards", partial(fence, PANEL_M, 1.2, kind="boards")),
    ("brick", partial(wall_panel, Material.BRICK_RED, (255, 240, 225))),
    ("rubble", partial(wall_panel, Material.RUBBLE, (255, 250, 240))),
    ("render", partial(wall_panel, Material.PLASTER, (235, 228, 212))),
)
"""Kinds of front fences; one place in seven has none."""


def add_gardens(cover: MeshBuilder, props: PropField, land: Land, lots: Sequence[Lot]) -> None:
    """Furnish the ground between sidewalks and the houses that stand back from them."""
    for lot in lots:
        style = lot.plan.appearance.style
        if style.ground == "dwelling" and style.front_m >= LEAST_M and lot.plan.storeys <= 3:
            garden = _Garden(land, lot)
            garden.fence(props)
            garden.slabs(cover)
            garden.beds(props)


class _Garden:
    """The ground before one house; `a` counts along its front and `b` towards the sidewalk."""

    def __init__(self, land: Land, lot: Lot) -> None:
        self._land, self._lot, style = land, lot, lot.plan.appearance.style
        self._style, self._width_m = style, lot.plan.width_m
        self._draw = clock.stream(land.seed, lot.name, index=2)
        self._along = np.array([elementary.cos(lot.heading_rad), elementary.sin(lot.heading_rad)])
        self._outward = np.array([self._along[1], -self._along[0]])
        bays = max(1, round((self._width_m - 0.8) / style.bay_m))
        self._door_m = 0.4 + (self._width_m - 0.8) / bays * (bays // 2 + 0.5)
        has_drive = style.gap_m > 4.0 and self._draw.random() < 0.6
        self._drive_m = self._width_m + 0.3 if has_drive else None

    def fence(self, props: PropField) -> None:
        """One kind of fence along the sidewalk, with a gate before the door; some gardens have none."""
        kind = int(self._draw.integers(0, len(PANELS) + 1))
        if kind == len(PANELS):
            return
        name, make = PANELS[kind]
        land, spare = self._land, min(self._style.gap_m / 2, 2.5)
        places = []
        end = self._width_m + (0.0 if self._drive_m else spare)
        for low, high in ((-spare, self._door_m - GATE_M), (self._door_m + GATE_M, end)):
            count = int((high - low) / PANEL_M)
            shift = high - count * PANEL_M if low < 0.0 else low
            places.append(shift + PANEL_M * np.arange(count))
        origin = self._lot.corner_m + self._outward * (self._style.front_m - 0.02)
        xy = origin + np.concatenate(places)[:, None] * self._along
        far = xy + PANEL_M * self._along
        clear = np.minimum(land.taken.distance_m(xy), land.taken.distance_m(far))
        free = np.minimum(clear, land.taken.distance_m((xy + far) / 2)) >= -0.45
        off = np.minimum(land.roads.distance_m(xy), land.roads.distance_m(far)) > -0.5
        xy = xy[free & off]
        middle = land.ground.height(xy + 0.5 * PANEL_M * self._along) if len(xy) else np.zeros(0)
        props.put(("garden", name), make, np.column_stack([xy, middle]), self._lot.heading_rad)

    def slabs(self, cover: MeshBuilder) -> None:
        """The path to the door and the drive."""
        front, land = self._style.front_m, self._land
        slabs = [(self._door_m - 0.6, self._door_m + 0.6, 0.0, Material.PAVEMENT, (225, 215, 205))]
        if self._drive_m is not None:
            back, grey = -0.6 * self._lot.plan.depth_m, (200, 198, 194)
            slabs.append((self._drive_m, self._drive_m + DRIVE_M, back, Material.CONCRETE, grey))
        for a0, a1, b0, material, tint in slabs:
            b = np.linspace(b0, front, max(2, int((front - b0) / 2.0) + 1))
            edges = [self._lot.corner_m + a * self._along + b[:, None] * self._outward for a in (a0, a1)]
            if land.taken.distance_m((edges[0] + edges[1])[:-1] / 2).min() < -0.9 and b0 < 0.0:
                continue
            rows = np.stack([land.on_ground(edge, 0.03) for edge in edges], axis=0)
            rows[:, -1, 2] -= 0.05
            cover.grid(rows, material=material, tag=Tag.GROUND, colour=tint)

    def beds(self, props: PropField) -> None:
        """Shrubs and flowers along the house."""
        draw = self._draw
        a = np.arange(0.6, self._width_m - 0.4, 1.3)
        a = a[(np.abs(a - self._door_m) > 2.0) & (draw.random(len(a)) < 0.55)]
        if not len(a):
            return
        b = draw.uniform(0.75, 1.1, len(a))
        xy = self._lot.corner_m + a[:, None] * self._along + b[:, None] * self._outward
        kind = draw.integers(0, len(_BLOOMS), len(a))
        scale, yaw = draw.uniform(0.45, 0.8, len(a)), draw.uniform(0, 2 * np.pi, len(a))
        for k, tint in enumerate(_BLOOMS):
            rows = kind == k
            make = partial(shrub, k, "low", tint)
            props.put(("bed", k), make, self._land.on_ground(xy[rows], -0.05), yaw[rows], scale[rows])
