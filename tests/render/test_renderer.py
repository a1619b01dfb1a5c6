"""The renderer as a whole: the same bytes, buffers of their own, clear errors, what is simpler from afar."""

from collections.abc import Iterator

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import CAMERA, FORWARD, ground, need_opengl, scene, wall

from carlaloc_env.core.errors import ConfigError, RenderError
from carlaloc_env.render.geometry.level_of_detail import coarse
from carlaloc_env.render.geometry.packed_meshes import lit_windows
from carlaloc_env.render.gl_context import create_context
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS

need_opengl()


@pytest.fixture(scope="module")
def street() -> Iterator[SceneRenderer]:
    with scene(ground(), wall(20.0, (-3.0, 0.0), (5.0, 4.0), instance=77)) as renderer:
        yield renderer


def test_same_call_gives_the_same_bytes(street: SceneRenderer) -> None:
    """Whatever was drawn and shaded in between."""
    weathers = [PRESETS[name] for name in ("ClearNoon", "FoggyNoon", "RainyNight")]
    first = [
        street.shade(street.draw(CAMERA, FORWARD, Instances()), w, stamp_ns=50, seed=3) for w in weathers
    ]
    elsewhere = FORWARD.copy()
    elsewhere[:3, 3] += (60.0, 200.0, 1.0)
    for weather in weathers:
        street.shade(street.draw(CAMERA, elsewhere, Instances()), weather)
    with scene(ground(), wall(20.0, (-3.0, 0.0), (5.0, 4.0), instance=77)) as fresh:
        for weather, picture in zip(weathers, first, strict=True):
            again = street.shade(street.draw(CAMERA, FORWARD, Instances()), weather, stamp_ns=50, seed=3)
            other = fresh.shade(fresh.draw(CAMERA, FORWARD, Instances()), weather, stamp_ns=50, seed=3)
            np.testing.assert_array_equal(again, picture)
            np.testing.assert_array_equal(other, picture)


def test_dither_is_keyed_by_stamp_and_stays_below_one_step(street: SceneRenderer) -> None:
    gbuffer = street.draw(CAMERA, FORWARD, Instances())
    a = street.shade(gbuffer, PRESETS["FoggyNoon"], stamp_ns=0, seed=3).astype(int)
    b = street.shade(gbuffer, PRESETS["FoggyNoon"], stamp_ns=50, seed=3).astype(int)
    assert np.abs(a - b).max() == 1


def test_gbuffers_stay_apart(street: SceneRenderer) -> None:
    """A G-buffer keeps its content while others are drawn."""
    gbuffer = street.draw(CAMERA, FORWARD, Instances())
    before = gbuffer.depth_m()
    elsewhere = FORWARD.copy()
    elsewhere[2, 3] = 9.0
    other = street.draw(CAMERA, elsewhere, Instances())
    np.testing.assert_array_equal(gbuffer.depth_m(), before)
    assert not np.array_equal(other.depth_m(), before)


def test_missing_opengl_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise Exception("libEGL.so.1 not loaded")

    monkeypatch.setattr("moderngl.create_context", refuse)
    with pytest.raises(RenderError, match="apt-get install libegl1 libgl1 libgl1-mesa-dri"):
        create_context()


def test_unknown_quality_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'medium'"):
        scene(ground(), quality="mediun")


def test_two_renderers_live_side_by_side() -> None:
    with scene(wall(10.0, (-1.0, 0.0), (1.0, 3.0))) as a, scene(wall(20.0, (-1.0, 0.0), (1.0, 3.0))) as b:
        pictures = [r.draw(CAMERA, FORWARD, Instances()) for r in (a, b, a)]
        assert [round(float(p.depth_m()[90, 160])) for p in pictures] == [10, 20, 10]


def test_leaves_keep_their_area_from_afar() -> None:
    random = np.random.default_rng(2)
    corners = random.normal(0, 3, (4000, 1, 3)) + random.normal(0, 0.1, (4000, 3, 3))
    crown = make_mesh(
        corners.reshape(-1, 3), np.arange(12000).reshape(-1, 3), material=Material.LEAF, tag=Tag.VEGETATION
    )

    def area_m2(mesh: Mesh) -> float:
        a, b, c = (mesh.vertices_m[mesh.triangles[:, i]] for i in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    far, _ = coarse(crown)
    assert len(far.triangles) == 1000
    assert area_m2(far) == pytest.approx(area_m2(crown), rel=0.05)


def test_both_halves_of_a_pane_are_lit_alike() -> None:
    random = np.random.default_rng(5)
    panes = []
    for x, y, z in random.uniform(-50, 50, (300, 3)):
        corners = [[x, y, z], [x + 1.2, y, z], [x + 1.2, y, z + 1.6], [x, y, z + 1.6]]
        panes += [
            make_mesh([corners[i] for i in half], [[0, 1, 2]], material=Material.WINDOW, tag=Tag.BUILDING)
            for half in ((0, 1, 2), (0, 2, 3))
        ]
    code = lit_windows(merge(panes)).reshape(300, 6)
    assert np.all(code == code[:, :1])
    assert 0.08 < (code[:, 0] > 0).mean() < 0.3
