"""The walkers of the catalogue, in every phase of their gait."""

from __future__ import annotations

from carlaloc_env.assets.catalog import GAIT_PHASES, WALKERS
from carlaloc_env.assets.figure import Build, figure
from carlaloc_env.assets.gait import posture, standing
from carlaloc_env.scene import Mesh
from carlaloc_env.semantics import Tag

BUILDS: dict[str, tuple[Build, float]] = {
    "walker_man": (Build(girth=1.0, lower=(14, 20, 44), hair=(14, 9, 5), bag=(22, 30, 24)), 3.0),
    "walker_woman": (
        Build(
            girth=0.86, hips=1.12, lower=(60, 12, 18), skin=(165, 108, 78), hair=(40, 20, 8), skirt=True,
            long_hair=True
        ),
        2.0,
    ),
    "walker_elderly": (
        Build(girth=1.06, lower=(66, 58, 46), skin=(160, 100, 74), hair=(150, 148, 145), hat=(34, 30, 26)),
        12.0,
    ),
    "walker_child": (
        Build(girth=0.74, lower=(24, 44, 90), skin=(120, 72, 46), hair=(10, 7, 5), bag=(150, 24, 20)), 2.0,
    ),
}  # fmt: skip
"""Girth, clothes and forward lean [deg] of each walker."""


def walker_models() -> dict[str, Mesh]:
    """Meshes named ``name/00`` … ``name/15`` and ``name/stand``."""
    models: dict[str, Mesh] = {}
    for name, (build, stoop_deg) in BUILDS.items():
        person = WALKERS[name]
        for k in range(GAIT_PHASES):
            joints = posture(k / GAIT_PHASES, person.stature_m, person.stride_m, stoop_deg=stoop_deg)
            models[f"{name}/{k:02d}"] = figure(joints, build, Tag.PEDESTRIAN)
        models[f"{name}/stand"] = figure(
            standing(person.stature_m, stoop_deg=stoop_deg), build, Tag.PEDESTRIAN
        )
    return models
