"""Walkers of the catalogue: their builds and clothes, and their meshes in every phase of their gait."""

from carlaloc_env.assets.catalog import (
    GAIT_PHASES,
    LOW_GAIT_PHASES,
    WALKERS,
)
from carlaloc_env.assets.walkers.clothing import Build
from carlaloc_env.assets.walkers.figure import skin_of
from carlaloc_env.assets.walkers.gait import posture, standing
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag

_GREY = (150, 148, 145)
_BROWN, _BLOND = (40, 20, 8), (130, 88, 34)
BUILDS: dict[str, tuple[Build, float]] = {
    "walker_man": (
        Build(stature_m=1.76, lower=(14, 20, 44), hair=(14, 9, 5), inner=(190, 188, 182), shoes=(60, 40, 24)),
        3.0,
    ),
    "walker_man_suit": (
        Build(
            stature_m=1.80, upper=(12, 14, 22), lower=(12, 14, 22), inner=(200, 204, 212), hair=_BROWN,
            skin=(175, 118, 88), carrier=(26, 14, 8), shoes=(4, 4, 4),
        ),
        2.0,
    ),
    "walker_man_stout": (
        Build(
            stature_m=1.74, girth=1.10, belly=1.28, lower=(52, 44, 32), skin=(70, 36, 22), bald=True,
            beard=True, hair=(10, 8, 7), short_sleeves=True, shoes=(120, 120, 118),
        ),
        0.0,
    ),
    "walker_youth": (
        Build(
            stature_m=1.70, girth=0.90, lower=(30, 32, 36), hair=(10, 7, 5), hat=(110, 12, 14),
            skin=(110, 62, 40), backpack=(14, 18, 26), shoes=(190, 190, 190),
        ),
        3.0,
    ),
    "walker_woman": (
        Build(
            stature_m=1.63, girth=0.86, hips=1.12, lower=(18, 26, 58), skin=(165, 108, 78), hair=_BROWN,
            long_hair=True, handbag=(96, 26, 12),
        ),
        2.0,
    ),
    "walker_woman_skirt": (
        Build(
            stature_m=1.66, girth=0.84, hips=1.10, lower=(60, 12, 18), skin=(180, 126, 96), hair=_BLOND,
            long_hair=True, skirt=True, short_sleeves=True, shoes=(90, 10, 14),
        ),
        1.0,
    ),
    "walker_woman_coat": (
        Build(
            stature_m=1.65, girth=0.88, hips=1.08, lower=(10, 10, 12), skin=(96, 54, 34), hair=(6, 5, 4),
            coat=True, carrier=(200, 190, 160), shoes=(20, 10, 6),
        ),
        2.0,
    ),
    "walker_elderly": (
        Build(
            stature_m=1.68, girth=1.02, belly=1.15, lower=(66, 58, 46), skin=(165, 104, 78), hair=_GREY,
            hat=(34, 30, 26), stick=True,
        ),
        12.0,
    ),
    "walker_elderly_woman": (
        Build(
            stature_m=1.58, girth=0.96, hips=1.12, belly=1.1, lower=(46, 40, 52), skin=(172, 116, 92),
            hair=_GREY, coat=True, handbag=(20, 12, 10),
        ),
        10.0,
    ),
    "walker_child": (
        Build(
            stature_m=1.28, girth=0.94, lower=(24, 44, 90), skin=(150, 92, 60), hair=(30, 16, 8), shorts=True,
            short_sleeves=True, backpack=(150, 24, 20), shoes=(170, 170, 170),
        ),
        2.0,
    ),
    "walker_girl": (
        Build(
            stature_m=1.18, girth=0.92, lower=(150, 40, 80), skin=(180, 120, 90), hair=_BLOND, long_hair=True,
            skirt=True, shoes=(180, 180, 180),
        ),
        1.0,
    ),
}  # fmt: skip
"""Build and forward lean [deg] of each walker."""


def walker_models() -> dict[str, Mesh]:
    """Meshes ``name/00`` … and ``name/stand``, and in few triangles ``name/low/00`` … ``name/low/stand``."""
    models: dict[str, Mesh] = {}
    for name, (build, stoop_deg) in BUILDS.items():
        person = WALKERS[name]
        for prefix, low, phases in ((name, False, GAIT_PHASES), (f"{name}/low", True, LOW_GAIT_PHASES)):
            postures = [
                posture(k / phases, person.stature_m, person.stride_m, stoop_deg=stoop_deg)
                for k in range(phases)
            ]
            postures.append(standing(person.stature_m, stoop_deg=stoop_deg))
            names = [*(f"{prefix}/{k:02d}" for k in range(phases)), f"{prefix}/stand"]
            skin = skin_of(build, Tag.PEDESTRIAN, low)
            models.update(zip(names, skin.posed_all(postures), strict=True))
    return models
