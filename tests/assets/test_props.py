"""Props, lights, signs and trees against sizes, textures and rays; shapes against formulas."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from shared_fixtures.worlds.meshes import facing_away, signed_volume_m3

from carlaloc_env.assets import posts_and_fences, street_furniture
from carlaloc_env.assets.plants import hedge, shrub
from carlaloc_env.assets.primitives import Look, box, lathe, mirrored, tube
from carlaloc_env.assets.signs import SIGNS, sign
from carlaloc_env.assets.texture_atlas import atlas_uv, street_name_uv
from carlaloc_env.assets.traffic_lights import traffic_light
from carlaloc_env.assets.tree_forms import FORMS
from carlaloc_env.assets.trees import tree
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag

PLAIN = Look(Material.PLAIN, Tag.STATIC)
PROPS = (
    street_furniture.lamp, street_furniture.bench, street_furniture.bin_, street_furniture.hydrant,
    street_furniture.bollard, street_furniture.banner, street_furniture.bus_shelter,
    street_furniture.advertising_column, street_furniture.newspaper_box, street_furniture.post_box,
    street_furniture.cabinet, street_furniture.planter, posts_and_fences.utility_pole,
    posts_and_fences.delineator, shrub, hedge,
)  # fmt: skip


@pytest.mark.parametrize("make", PROPS)
def test_props_stand_at_the_origin_and_show_their_outside(make: Callable[[], Mesh]) -> None:
    mesh = make()
    assert mesh.bounds_m[0, 2] > -0.07 or make is street_furniture.banner
    assert signed_volume_m3(mesh) > 0
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)
    if make is not hedge:
        assert facing_away(mesh, 1500) < 0.02


def test_shapes_have_the_volume_of_their_formula() -> None:
    assert signed_volume_m3(box(PLAIN, (2, 3, 4), (5, 6, 7))) == pytest.approx(24.0)
    prism = 0.5 * 8 * math.sin(2 * math.pi / 8) * 0.2**2
    assert signed_volume_m3(tube(PLAIN, [(0, 0, 0), (0, 0, 3)], 0.2, 8)) == pytest.approx(3 * prism, rel=1e-5)
    assert signed_volume_m3(tube(PLAIN, [(0, 0, 0), (3, 0, 0)], 0.2, 8)) == pytest.approx(3 * prism, rel=1e-5)
    cone = lathe(PLAIN, [(1.0, 0.0), (1e-6, 3.0)], 64)
    assert signed_volume_m3(cone) == pytest.approx(math.pi, rel=0.01)
    assert signed_volume_m3(mirrored(cone)) == pytest.approx(math.pi, rel=0.01)


@pytest.mark.parametrize(("heads", "arm_m"), [(1, 0.0), (2, 0.0), (2, 7.0), (3, 9.0)])
def test_traffic_light_lenses_sit_on_their_heads(heads: int, arm_m: float) -> None:
    mesh, lenses = traffic_light(heads, arm_m)
    assert lenses.shape == (heads, 3, 4, 4)
    assert np.all(np.diff(lenses[:, :, 2, 3], axis=1) < 0), "red above yellow above green"
    np.testing.assert_allclose(lenses[..., :3, 0], np.broadcast_to([1.0, 0, 0], (heads, 3, 3)), atol=1e-12)
    tagged = mesh.vertices_m[mesh.tag == Tag.TRAFFIC_LIGHT]
    for centre in lenses[..., :3, 3].reshape(-1, 3):
        near = tagged[np.linalg.norm(tagged - centre, axis=1) < 0.02]
        assert len(near) > 0
    if arm_m:
        assert lenses[0, 2, 2, 3] > 5.2
        assert lenses[..., 1, 3].min() < -0.8 * arm_m


@pytest.mark.parametrize("kind", SIGNS)
def test_sign_faces_show_their_cell(kind: str) -> None:
    mesh = sign(kind)
    face = (mesh.material == Material.SIGN) & (mesh.normals[:, 0] > 0.9)
    u0, v0, u1, v1 = atlas_uv(Material.SIGN, SIGNS[kind][0])
    uv = mesh.uv_m[face]
    assert face.sum() >= 3
    assert uv[:, 0].min() >= u0 - 1e-6
    assert uv[:, 0].max() <= u1 + 1e-6
    assert uv[:, 1].min() >= v0 - 1e-6
    assert uv[:, 1].max() <= v1 + 1e-6
    # Read from +x, right is +y and up is +z.
    centred = mesh.vertices_m[face] - mesh.vertices_m[face].mean(axis=0)
    assert np.sum(centred[:, 1] * (uv[:, 0] - uv[:, 0].mean())) > 0
    assert np.sum(centred[:, 2] * (uv[:, 1] - uv[:, 1].mean())) > 0


def test_signs_choose_by_text_and_name_the_nearest() -> None:
    assert np.array_equal(sign("speed", "48").uv_m, sign("speed_50").uv_m)
    used = sign("street_name", "OAK AVE").uv_m
    u0, v0, u1, v1 = street_name_uv(1)
    assert np.any(
        (used[:, 0] > u0) & (used[:, 0] <= u1 + 1e-6) & (used[:, 1] >= v0 - 1e-6) & (used[:, 1] <= v1 + 1e-6)
    )
    with pytest.raises(ConfigError, match="did you mean 'stop'"):
        sign("stopp")


@pytest.mark.parametrize("kind", FORMS)
def test_trees_keep_their_leaf_area_at_low_detail(kind: str) -> None:
    def leaf_area(mesh: Mesh) -> float:
        a, b, c = (mesh.vertices_m[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
        leaf = mesh.material[mesh.triangles[:, 0]] == Material.LEAF
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)[leaf].sum())

    high, low = tree(kind, 5), tree(kind, 5, "low")
    assert leaf_area(low) == pytest.approx(leaf_area(high), rel=0.12)
    assert len(low.triangles) < 0.25 * len(high.triangles)
    assert 600 < len(high.triangles) < 4200
    form, height = FORMS[kind], high.bounds_m[1, 2]
    assert 0.75 * form.height_m[0] < height < 1.12 * form.height_m[1]
    assert set(np.unique(high.tag)) == {int(Tag.VEGETATION)}


def test_trees_are_the_same_for_the_same_seed_only() -> None:
    a, b, c = tree("plane", 7), tree("plane", 7), tree("plane", 8)
    assert a.vertices_m.tobytes() == b.vertices_m.tobytes()
    assert len(a.vertices_m) != len(c.vertices_m) or a.vertices_m.tobytes() != c.vertices_m.tobytes()
    with pytest.raises(ConfigError, match="did you mean 'conifer'"):
        tree("conifir")
    assert hedge(4.0, 1.2, 0.6).bounds_m[1, 0] == pytest.approx(4.0, abs=0.15)
