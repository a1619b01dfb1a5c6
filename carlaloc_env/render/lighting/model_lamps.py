"""Lamps of movable models: headlamps, tail and brake lights, indicators and traffic lights.

Lamps are read off the lamp materials of a model, so that every lens that is drawn shines.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.render.lighting.light_sources import Lights
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Instances, Mesh, ModelLibrary

BEAM_RANGE_M = 60.0
"""Where low beams end [m]; the cut-off meets the road there."""
EGO_HEADLAMPS_M = (3.65, 0.0, 0.65)
"""Between the ego's headlamps, in `base_link` [m]."""
REVERSE_CD, REVERSE_RANGE_M = 120.0, 9.0
"""A reversing lamp (UN regulation 148: 80 to 600 cd), and where its light has faded [m]."""
HEADLAMP_COLOUR = np.array([1.10, 0.99, 0.80])
"""Linear colour of a headlamp, about 4000 K."""
HEADLAMP_LIGHT = 2.0 * HEADLAMP_COLOUR
"""A pair of headlamps is followed as one of twice the light."""
HALO_CD = 360.0
"""Intensity of a pair of headlamps above its cut-off, all round its front [cd]."""
_SIGNAL_CD = 80.0
"""Intensity of the lens of a traffic light [cd]."""
_SIGNAL_RANGE_M = 22.0
"""Where the light of a traffic light has faded [m]."""
_SIGNAL_EDGE = (0.80, 1.0)
"""Cosines between which a signal fades: a quarter is left at 30° (EN 12368, class W)."""
_SIGNAL_GLOW = 0.3
"""Mean intensity of such a narrow beam over the half-sphere before it, as a share of the axis."""
_PLAIN_EDGE = (0.0, 0.6)
"""Cosines between which a plain lamp fades to the side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    """Colour, intensity and range of the lamps of one material."""

    colour: tuple[float, float, float]
    intensity_cd: float
    range_m: float
    side: float
    """Whether it shines ahead (1) or back (−1)."""


# Intensities: UN regulations 7, 48 and 148 (tail 4–17 cd, stop 60–260 cd, indicators 50–500 cd) and
# EN 12368 (300 mm lens ≥ 400 cd, 80 cd when dimmed at night).
_KINDS: Mapping[Material, _Kind] = {
    Material.LAMP_TAIL: _Kind(colour=(1.0, 0.03, 0.01), intensity_cd=7.0, range_m=4.0, side=-1.0),
    Material.LAMP_RED: _Kind(colour=(1.0, 0.03, 0.01), intensity_cd=60.0, range_m=9.0, side=-1.0),
    Material.LAMP_AMBER: _Kind(colour=(1.0, 0.42, 0.02), intensity_cd=80.0, range_m=7.0, side=1.0),
    Material.LAMP_GREEN: _Kind(colour=(0.05, 1.0, 0.45), intensity_cd=0.0, range_m=20.0, side=1.0),
}
"""How the lamps of vehicles and traffic lights shine, by material."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lamp:
    """A lamp of a model, in the model's frame."""

    position_m: Array
    axis: Array
    colour_cd: Array
    range_m: float
    glow_cd: float
    edge: tuple[float, float] = _PLAIN_EDGE
    beam: bool = False


_EGO_BEAM = _Lamp(
    position_m=np.array(EGO_HEADLAMPS_M),
    axis=np.array([1.0, 0.0, 0.0]),
    colour_cd=HEADLAMP_LIGHT,
    range_m=BEAM_RANGE_M,
    glow_cd=0.0,
    beam=True,
)
"""Low beams of the ego, whose body shows no lenses."""


class Emitters:
    """Places of the lamps on the models of a library."""

    def __init__(self, library: ModelLibrary) -> None:
        lamps = [_lamps_of(name, mesh) for name, mesh in zip(library.names, library.meshes, strict=True)]
        self._count = np.array([len(some) for some in lamps], dtype=np.intp)
        self.model = np.repeat(np.arange(len(library)), self._count)
        self._begin = np.cumsum(self._count) - self._count
        rows = [*itertools.chain.from_iterable(lamps), _EGO_BEAM]
        self._lamps = {name: np.array([getattr(row, name) for row in rows]) for name in _Lamp.__slots__}
        """Rows of all models' lamps, then the ego's low beams."""

    def lights(self, instances: Instances) -> Lights:
        """Lamps of placed models, and the low beams of the ego if its body is among them."""
        count = self._count[instances.model]
        who = np.repeat(np.arange(len(instances)), count)
        start = np.cumsum(count) - count
        row = np.repeat(self._begin[instances.model] - start, count) + np.arange(len(who))
        ego = np.flatnonzero(instances.instance == EGO_INSTANCE)[:1]
        who, row = np.append(who, ego), np.append(row, np.full(len(ego), len(self.model)))
        lamps = {name: column[row] for name, column in self._lamps.items()}
        T, place, axis = instances.T_world_model[who], lamps.pop("position_m"), lamps.pop("axis")
        return Lights(
            position_m=np.sum(T[:, :3, :3] * place[:, None, :], axis=2) + T[:, :3, 3],
            axis=np.sum(T[:, :3, :3] * axis[:, None, :], axis=2),
            left=T[:, :3, 1].copy(),
            cap=np.ones(len(place)),
            **lamps,
        )


def _lamps_of(name: str, mesh: Mesh) -> list[_Lamp]:
    """Every lamp of a model."""
    signal = name.startswith("signal_")
    corner = mesh.material[mesh.triangles[:, 0]] if len(mesh.triangles) else np.zeros(0, np.uint8)
    ahead = np.eye(3)[0]
    # Lamps of whole vehicles lie low; bright roof signs do not light the road.
    lamps = [
        replace(_EGO_BEAM, position_m=place, glow_cd=HALO_CD)
        for place in _patches(mesh, corner == Material.LAMP_WHITE, whole=True, side=1.0)
        if 0.3 < place[2] < 1.3
    ]
    if name.endswith("/reverse"):
        lamps += [
            _Lamp(
                position_m=place,
                axis=-ahead,
                colour_cd=REVERSE_CD * HEADLAMP_COLOUR,
                range_m=REVERSE_RANGE_M,
                glow_cd=REVERSE_CD,
            )
            for place in _patches(mesh, corner == Material.LAMP_WHITE, whole=False, side=-1.0)
        ]
    for material, kind in _KINDS.items():
        side = 1.0 if signal else kind.side
        intensity = _SIGNAL_CD if signal else kind.intensity_cd
        if intensity <= 0.0:
            continue
        # Indicators burn at both ends; the ones that face back are seen from behind.
        facings = (side, -side) if material == Material.LAMP_AMBER and not signal else (side,)
        lamps += [
            _Lamp(
                position_m=place,
                axis=facing * ahead,
                colour_cd=np.array(kind.colour) * intensity,
                range_m=_SIGNAL_RANGE_M if signal else kind.range_m,
                glow_cd=intensity * (_SIGNAL_GLOW if signal else 1.0),
                edge=_SIGNAL_EDGE if signal else _PLAIN_EDGE,
            )
            for facing in facings
            for place in _patches(mesh, corner == material, whole=signal, side=facing)
        ]
    return lamps


def _patches(mesh: Mesh, chosen: NDArray[np.bool_], *, whole: bool, side: float) -> list[Array]:
    """Middles [m] of the chosen triangles that face ahead (side 1) or back: one, or left and right."""
    triangles = mesh.triangles[chosen]
    a, b, c = (mesh.vertices_m[triangles[:, i]].astype(np.float64) for i in range(3))
    weight = np.maximum(cross(b - a, c - a)[:, 0] * side, 0.0)
    middle = (a + b + c) / 3.0
    left = middle[:, 1] >= 0.0
    groups = [np.ones(len(middle), bool)] if whole else [left, ~left]
    return [
        np.sum(middle[group] * weight[group, None], axis=0) / np.sum(weight[group])
        for group in groups
        if np.sum(weight[group]) > 1e-6
    ]
