"""Figure of a walker: a skin over the bones, dressed, with its head and accessories."""

from functools import lru_cache

from carlaloc_env.assets.walkers.accessories import add_bags_and_stick, add_skirt
from carlaloc_env.assets.walkers.clothing import Build, SkinBuilder
from carlaloc_env.assets.walkers.heads import add_face, add_head
from carlaloc_env.assets.walkers.skeleton import Joints, Skin
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag


def figure(joints: Joints, build: Build, tag: Tag, *, low: bool = False) -> Mesh:
    """Mesh of a person in the posture given by the joints; x is ahead, y left."""
    return skin_of(build, tag, low).posed(joints)


@lru_cache(maxsize=64)
def skin_of(build: Build, tag: Tag, low: bool) -> Skin:
    """Skin of a person: 900 to 1700 triangles, or about 300 for one far away."""
    builder = SkinBuilder(build, tag, low)
    builder.torso()
    add_head(builder)
    for side in ("_l", "_r"):
        builder.leg(side)
        builder.arm(side)
    if build.skirt or build.coat:
        add_skirt(builder)
    if not low:
        add_face(builder)
    add_bags_and_stick(builder)
    return builder.finish()
