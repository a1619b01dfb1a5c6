"""Uniforms that travel as flat varyings: the same bits in every pixel."""

import moderngl
import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import CAMERA, FORWARD, ground, need_opengl, scene, wall

from carlaloc_env.render import shader_programs
from carlaloc_env.render.flat_uniforms import hoisted
from carlaloc_env.render.gl_context import create_context
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.weather.presets import PRESETS

need_opengl()

VERTEX = """uniform vec2 u_both;
void main() {
    vec2 corner = vec2(float((gl_VertexID & 1) << 2) - 1.0, float((gl_VertexID & 2) << 1) - 1.0);
    gl_Position = vec4(corner, 0.0, 1.0) + 0.0 * u_both.xyxy;
}
"""
FRAGMENT = """uniform vec2 u_both;
#ifdef WANTED
uniform vec3 u_list[2];
uniform uint u_key;   // any bits
#else
uniform mat3 u_missing;
#endif
layout(location = 0) out vec4 o_colour;
void main() {
    o_colour = vec4(u_both + u_list[1].xy, u_list[0].z, uintBitsToFloat(u_key));
}
"""


def _drawn(vertex: str, fragment: str) -> np.ndarray:
    """What the two shaders draw on one pixel, with some values told to them."""
    head = "#version 430 core\n#define WANTED\n"
    context = create_context()
    with context:
        program = context.program(vertex_shader=head + vertex, fragment_shader=head + fragment)
        values = {"u_both": [0.25, 7.0], "u_list": [1.0, 2.0, 3.0, 1 / 3, 5.0, 6.0]}
        for name, value in values.items():
            program[name].write(np.array(value, "<f4").tobytes())  # type: ignore[union-attr]
        program["u_key"].write(np.array([0x80000001], "<u4").tobytes())  # type: ignore[union-attr]
        texture = context.texture((1, 1), 4, dtype="f4")
        context.framebuffer([texture]).use()
        context.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)
        found = np.frombuffer(texture.read(), "<u4").copy()
    context.release()
    return found


def test_hoisted_uniforms_reach_pixels_bit_by_bit() -> None:
    """A whole array, a value that both shaders read, and bits that are no number worth the name."""
    plain = _drawn(VERTEX, FRAGMENT)
    vertex, fragment = hoisted(VERTEX, FRAGMENT)
    assert "uniform" not in fragment
    assert vertex.count("uniform vec2 u_both;") == 1
    np.testing.assert_array_equal(_drawn(vertex, fragment), plain)
    expected = np.array([0.25 + np.float32(1 / 3), 12.0, 3.0], "<f4").view("<u4")
    np.testing.assert_array_equal(plain, [*expected, 0x80000001])


@pytest.mark.parametrize("weather", ["ClearNoon", "FoggyNoon", "RainyNight"])
def test_images_are_the_same_bytes_with_plain_uniforms(weather: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A street drawn and shaded by programs as they are written, and by those with varyings."""
    lamps_m = np.array([[12.0, 4.0, 7.0], [30.0, -3.0, 7.0]])
    changed = []

    def untouched(vertex: str, fragment: str) -> tuple[str, str]:
        changed.append(hoisted(vertex, fragment) != (vertex, fragment))
        return vertex, fragment

    images = []
    for how in (hoisted, untouched):
        monkeypatch.setattr(shader_programs, "hoisted", how)
        with scene(ground(), wall(20.0, (-3.0, 0.0), (5.0, 4.0)), lamps_m=lamps_m) as renderer:
            images.append(renderer.shade(renderer.draw(CAMERA, FORWARD, Instances()), PRESETS[weather]))
    np.testing.assert_array_equal(images[0], images[1])
    assert any(changed) or not changed, "on a software driver some uniforms are handed over"


def test_textures_images_and_comments_stay_as_they_are() -> None:
    kept = (
        "uniform sampler2DShadow u_shadow;\n"
        "layout(rgba32f) readonly uniform image2D u_lists;   // uniform to all\n"
        "// a uniform vec3 in a comment\n"
    )
    assert kept in hoisted(VERTEX, kept + FRAGMENT)[1]
