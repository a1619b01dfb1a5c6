"""Renderers one after another in the same context: nothing is left behind, pictures stay the same."""

from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import CAMERA, FORWARD, ground, need_opengl, scene, wall

from carlaloc_env.render.lighting.shader_constants import shader_constants
from carlaloc_env.render.shader_programs import give_back, take_programs
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, ModelLibrary
from carlaloc_env.weather.presets import PRESETS

need_opengl()

MAKERS = (
    "buffer", "texture", "texture_array", "depth_texture", "renderbuffer", "depth_renderbuffer",
    "framebuffer", "vertex_array",
)  # fmt: skip
LAMPS_M = np.array([[12.0, 3.0, 6.0], [25.0, -3.0, 6.0]])


def _box() -> ModelLibrary:
    return ModelLibrary({"box": wall(0.0, (-1.0, 0.0), (1.0, 2.0), material=Material.CAR_PAINT)})


def _boxes(count: int) -> Instances:
    pose = np.tile(np.eye(4), (count, 1, 1))
    pose[:, 0, 3] = np.linspace(8.0, 60.0, count)
    return Instances(
        model=np.zeros(count, np.int32),
        T_world_model=pose,
        instance=np.arange(1, count + 1, dtype=np.uint32),
        tint=np.ones((count, 3), np.float32),
    )


def _drawn(weather: str, boxes: int, *, quality: str = "medium", far_m: float = 40.0) -> NDArray[np.uint8]:
    """A picture by a renderer that lives no longer."""
    things = (ground(), wall(far_m, (-8.0, 0.0), (8.0, 9.0)))
    with scene(*things, library=_box(), quality=quality, lamps_m=LAMPS_M) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, _boxes(boxes))
        return renderer.shade(gbuffer, PRESETS[weather], stamp_ns=5, seed=1)


def test_pictures_are_the_same_in_a_context_that_was_used() -> None:
    """Other scenes, qualities, sizes of buffers and weathers leave nothing behind."""
    first = {name: _drawn(name, 3) for name in ("ClearNoon", "RainyNight")}
    _drawn("RainyNight", 900, quality="high", far_m=15.0)
    _drawn("FoggyNoon", 0, quality="low")
    for name, picture in first.items():
        np.testing.assert_array_equal(_drawn(name, 3), picture)


def test_a_context_is_handed_on_and_never_shared() -> None:
    constants = shader_constants()
    ours, theirs = take_programs(constants), take_programs(constants)
    assert ours.context is not theirs.context
    program = ours.get("screen.vert", "resolve.frag")
    give_back(theirs)
    give_back(ours)
    again = take_programs(constants)
    assert again.context is ours.context
    assert again.get("screen.vert", "resolve.frag") is program
    give_back(again)


def test_a_closed_renderer_has_released_all_that_it_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also buffers that became too small, and what hangs on framebuffers."""
    made: list[Any] = []
    for name in MAKERS:
        maker = getattr(moderngl.Context, name)

        def noted(*arguments: Any, _maker: Any = maker, **settings: Any) -> Any:
            made.append(_maker(*arguments, **settings))
            return made[-1]

        monkeypatch.setattr(moderngl.Context, name, noted)
    for weather in ("ClearNoon", "RainyNight"):
        _drawn(weather, 900, quality="high")
    _drawn("WetNoon", 900, quality="low")
    assert len(made) > 100
    held = [thing for thing in made if not isinstance(thing.mglo, moderngl.mgl.InvalidObject)]
    assert not held
