"""Lights in few words, and uniforms that travel as flat varyings."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from carlaloc_env.core.errors import RenderError
from carlaloc_env.render.gl.context import create_context
from carlaloc_env.render.gl.uniform_hoisting import hoisted
from carlaloc_env.render.lighting.light_packing import air_words, surface_words
from carlaloc_env.render.lighting.light_sources import HEADLAMP_COLOUR, street_lamps

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
    try:
        plain = _drawn(VERTEX, FRAGMENT)
    except RenderError as error:
        pytest.skip(str(error))
    vertex, fragment = hoisted(VERTEX, FRAGMENT, {"WANTED"})
    assert "uniform" not in fragment.replace("uniform mat3 u_missing;", "")
    assert vertex.count("uniform vec2 u_both;") == 1
    np.testing.assert_array_equal(_drawn(vertex, fragment), plain)
    expected = np.array([0.25 + np.float32(1 / 3), 12.0, 3.0], "<f4").view("<u4")
    np.testing.assert_array_equal(plain, [*expected, 0x80000001])


def _halves(words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two numbers of words as the shaders take them apart."""
    return (words & 0xFFFF0000).view("<f4"), (words << 16).astype("<u4").view("<f4")


def _fixed(words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    signed = words.view("<i4")
    return (signed >> 16) / 32767.0, (words << 16).astype("<u4").view("<i4") / 65536.0 / 32767.0


def test_words_hold_what_lights_are() -> None:
    """Random lamps and low beams, read back as the shaders do: strengths within 0.4 %."""
    random = np.random.default_rng(7)
    count = 60
    axis = random.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    left = np.cross(axis, random.normal(size=(count, 3)))
    left /= np.linalg.norm(left, axis=1)[:, None]
    lights = replace(
        street_lamps(random.uniform(-200, 200, (count, 3))),
        axis=axis,
        left=left,
        colour_cd=random.uniform(0.1, 30000.0, (count, 3)),
        range_m=random.uniform(3.0, 90.0, count),
        beam=random.random(count) < 0.5,
    )
    eye, exposure = np.array([10.0, -4.0, 1.5]), 0.37
    words = surface_words(lights, eye, exposure)
    assert words.shape == (count + 1, 8)
    assert not words[-1].any()
    row = words[:-1]
    np.testing.assert_array_equal(row[:, :3].view("<f4"), (lights.position_m - eye).astype("<f4"))
    strength = lights.colour_cd * exposure / np.pi
    (red, green), (blue, last) = _halves(row[:, 3]), _halves(row[:, 4])
    beam, lamp = lights.beam, ~lights.beam
    np.testing.assert_allclose(np.column_stack([red, green, blue])[lamp], strength[lamp], rtol=2.0**-8)
    np.testing.assert_allclose(last[lamp], lights.cap[lamp], rtol=2.0**-8)
    per_range2 = 1.0 / lights.range_m**2
    alone = row[beam, 3:5].view("<f4")
    np.testing.assert_allclose(alone[:, 0], strength[beam, 1] / HEADLAMP_COLOUR[1], rtol=1e-6)
    np.testing.assert_allclose(alone[:, 1], per_range2[beam], rtol=1e-6)
    (x, y), (z, left_x) = _fixed(row[:, 5]), _fixed(row[:, 6])
    np.testing.assert_allclose(np.column_stack([x, y, z]), axis, atol=1 / 65534)
    np.testing.assert_allclose(left_x[beam], left[beam, 0], atol=1 / 65534)
    np.testing.assert_allclose(np.column_stack(_fixed(row[:, 7]))[beam], left[beam, 1:], atol=1 / 65534)
    np.testing.assert_allclose(_halves(row[:, 6])[1][lamp], per_range2[lamp], rtol=2.0**-8)
    begin, per_way = _halves(row[:, 7])
    np.testing.assert_allclose(begin[lamp], lights.edge[lamp, 0], rtol=2.0**-8)
    np.testing.assert_allclose(per_way[lamp], 1 / np.diff(lights.edge, axis=1)[lamp, 0], rtol=2.0**-8)
    reach = random.uniform(0.3, 8.0, count)
    air = air_words(lights, eye, exposure, reach)[:-1]
    np.testing.assert_allclose(_halves(air[:, 4])[1], 1 / reach**2, rtol=2.0**-8)
    brightest = np.max(np.column_stack([*_halves(air[:, 3]), _halves(air[:, 4])[0]]), axis=1)
    np.testing.assert_allclose(brightest, lights.glow_cd * exposure / np.pi, rtol=2.0**-8)
