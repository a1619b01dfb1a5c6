"""Walkers: a dressed figure in any posture."""

from __future__ import annotations

from functools import lru_cache

from carlaloc_env.assets.walkers.accessories import skirt, things
from carlaloc_env.assets.walkers.clothing import Build, SkinBuilder
from carlaloc_env.assets.walkers.heads import face, head
from carlaloc_env.assets.walkers.skeleton import Joints, Skin
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag


def figure(joints: Joints, build: Build, tag: Tag, *, low: bool = False) -> Mesh:
    """Mesh of a person in the posture given by the joints; x is ahead, y left."""
    return skin_of(build, tag, low).posed(joints)


@lru_cache(maxsize=64)
def skin_of(build: Build, tag: Tag, low: bool = False) -> Skin:
    """Skin of a person: 900 to 1700 triangles, or about 300 for one far away."""
    builder = SkinBuilder(build, tag, low)
    builder.torso()
    head(builder)
    for side in ("_l", "_r"):
        builder.leg(side)
        builder.arm(side)
    if build.skirt or build.coat:
        skirt(builder)
    if not low:
        face(builder)
    things(builder)
    return builder.finish()
