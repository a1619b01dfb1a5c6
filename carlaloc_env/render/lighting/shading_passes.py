"""The passes that shade a picture: in one piece, or tile by tile with what each tile needs.

Numbers that shaders share with Python, as defines: each has one owner, in Python.

Reflections of the scene in wet level ground, at a third of the picture's columns and rows.

Grains of the ground smear them, so that they need not be as fine as the picture.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.render.geometry.gbuffer import GBuffer
from carlaloc_env.render.geometry.packed_meshes import LOG_SCALE
from carlaloc_env.render.gl_context import Programs, glsl
from carlaloc_env.render.lighting.light_sources import LAMP_COLOUR, LAMP_LEAST_M
from carlaloc_env.render.lighting.light_table import (
    LIST_COLUMNS,
    LOW_BEAM_BELLS,
    LOW_BEAM_CUT_OFF,
    LOW_BEAM_DEGREES,
    LOW_BEAM_HAZE,
    LOW_BEAM_LEAST_AHEAD,
    TEXELS,
)
from carlaloc_env.render.lighting.light_tiles import RETROREFLECTION, TILE_PX, TileGroups
from carlaloc_env.render.lighting.night_lighting import SKY_M
from carlaloc_env.render.lighting.uniforms import FOG_FLOOR_M
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene import mottle

_SKY_FEATURES = ("TILES", "NIGHT", "LINEAR", "GLOWS")
"""Features that the sky's program has."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cover:
    """Tiles of a picture and what draws them."""

    groups: TileGroups
    draw: Callable[[moderngl.Program, int, int], None]
    """Draws tiles of `groups`: program, first tile, how many."""
    view: CameraView

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of all tiles together."""
        camera = self.view.camera
        return -(-camera.width_px // TILE_PX) * TILE_PX, -(-camera.height_px // TILE_PX) * TILE_PX


class ShadingPasses:
    """Draws surfaces and the sky of one picture."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        features: tuple[str, ...],
        prepare: Callable[[moderngl.Program], None],
        *,
        splits: bool,
    ) -> None:
        """Make ready.

        Args:
            context: Where it is drawn; the picture's framebuffer is bound.
            programs: Shader programs of the context.
            features: Features of the program of the picture's surfaces.
            prepare: Sets the uniforms of a program.
            splits: Whether a pixel is either surface or sky; otherwise surfaces are laid over their sky.
        """
        self._context = context
        self._programs = programs
        self._features = features
        self._prepare = prepare
        self._splits = splits
        self._prepared: set[int] = set()

    def whole(self, triangle: Callable[[moderngl.Program], None]) -> None:
        """Draw all in one piece."""
        # The depth test splits the picture: surfaces lie before the triangle, the sky on it.
        self._test(">" if self._splits else "")
        triangle(self._program("shade.frag", self._features))
        if self._splits:
            self._test("==")
            triangle(self._program("sky.frag", self._features))

    def tiles(self, cover: Cover) -> None:
        """Draw tile by tile; tiles without sky, or of nothing else, need no test."""
        for kind, (first, count) in cover.groups.groups.items():
            if not count:
                continue
            features = (*self._features, "TILES", *kind)
            program = self._program("shade.frag", features)
            self._test("")
            if not self._splits:
                cover.draw(program, first, count)
                continue
            cover.draw(program, *cover.groups.of(kind, (0, 0)))
            self._test(">")
            cover.draw(program, *cover.groups.of(kind, (1, 1)))
            first, count = cover.groups.of(kind, (1, 2))
            if count:
                self._test("==")
                cover.draw(self._program("sky.frag", features), first, count)

    def _program(self, fragment: str, features: tuple[str, ...]) -> moderngl.Program:
        if fragment == "sky.frag":
            features = tuple(name for name in features if name in _SKY_FEATURES)
        program = self._programs.get("screen.vert", fragment, *features)
        if program.glo not in self._prepared:
            self._prepare(program)
            self._prepared.add(program.glo)
        return program

    def _test(self, function: str) -> None:
        """Compare with the depths of surfaces before shading a pixel, or with '' do not."""
        test = moderngl.DEPTH_TEST if function else moderngl.NOTHING
        self._context.enable_only(test | moderngl.PROGRAM_POINT_SIZE)
        if function:
            self._context.depth_func = function


COLUMN_PX, ROW_PX = 3, 3
"""Pixels of the picture for one of the mirror's."""
SMEAR = 9.0
"""Level of the mirror by the roughness of the ground: film on asphalt smears it over about a degree."""
LEVELS = 5
"""Halvings of the mirror, which stand for smears of rough ground."""
_MARGIN = 0.03
"""How far above the horizon ground is still looked for, as a share of the picture's height."""


class Mirror:
    """Draws what wet ground mirrors of the scene round it."""

    def __init__(self, context: moderngl.Context, programs: Programs) -> None:
        self._context = context
        self._programs = programs
        self._targets: dict[tuple[int, int], tuple[moderngl.Texture, moderngl.Framebuffer]] = {}

    def draw(
        self,
        gbuffer: GBuffer,
        features: tuple[str, ...],
        prepare: Callable[[moderngl.Program], None],
        triangle: Callable[[moderngl.Program], None],
    ) -> moderngl.Texture:
        """Texture of the mirrored light; its alpha is where the mirrored ray meets the scene.

        Args:
            gbuffer: The picture.
            features: Features of the shader.
            prepare: Sets the uniforms of the program.
            triangle: Draws a triangle over everything.
        """
        camera = gbuffer.camera
        size_px = -(-camera.width_px // COLUMN_PX), -(-camera.height_px // ROW_PX)
        texture, framebuffer = self._target(size_px)
        framebuffer.use()
        framebuffer.clear()
        scale = f"COLUMN_PX {COLUMN_PX}", f"ROW_PX {ROW_PX}"
        program = self._programs.get("screen.vert", "mirror.frag", *scale, *features)
        prepare(program)
        top = round(texture.height * max(horizon(gbuffer.view) - _MARGIN, 0.0))
        self._context.enable_only(moderngl.NOTHING)
        if top < texture.height:
            framebuffer.scissor = (0, top, texture.width, texture.height - top)
            triangle(program)
            framebuffer.scissor = (0, 0, texture.width, texture.height)
        texture.build_mipmaps(max_level=LEVELS)
        return texture

    def _target(self, size_px: tuple[int, int]) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        if size_px not in self._targets:
            texture = self._context.texture(size_px, 4, dtype="f2")
            texture.build_mipmaps(max_level=LEVELS)
            texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
            texture.repeat_x = texture.repeat_y = False
            self._targets[size_px] = (texture, self._context.framebuffer([texture]))
        return self._targets[size_px]

    def release(self) -> None:
        """Free the textures."""
        for texture, framebuffer in self._targets.values():
            framebuffer.release()
            texture.release()


def horizon(view: CameraView) -> float:
    """Where the horizon's highest end meets the left or right edge, as a share of the picture's height."""
    camera = view.camera
    edges = np.array([-camera.cx_px, camera.width_px - camera.cx_px]) / camera.fx_px
    right, down, ahead = view.R_camera_world[:, 2]
    if abs(down) < 1e-3:
        return 0.0
    # The rays (x, y, 1) with no upward part: right · x + down · y + ahead = 0.
    rows = (-(right * edges + ahead) / down) * camera.fy_px + camera.cy_px
    return float(np.min(rows)) / camera.height_px


TONE_SHOULDER, TONE_ROOM = 0.6, 0.4
"""Exposed light up to which the tone curve is straight, and what lies between it and white."""


def shader_constants() -> tuple[str, ...]:
    """Names and values for the `#define` lines of every program."""
    cut, rise, end = LOW_BEAM_CUT_OFF
    values: dict[str, ArrayLike] = {
        "LAMP_COLOUR": LAMP_COLOUR,
        "LAMP_LEAST_M2": LAMP_LEAST_M**2,
        "MIRROR_SMEAR": SMEAR,
        "LOG_SCALE": LOG_SCALE,
        "LOW_BEAM_DEGREES": LOW_BEAM_DEGREES,
        "LOW_BEAM_LEAST_AHEAD": LOW_BEAM_LEAST_AHEAD,
        "LOW_BEAM_CUT": cut,
        "LOW_BEAM_RISE": rise,
        "LOW_BEAM_END": end,
        "RETROREFLECTION": RETROREFLECTION,
        "GLOW_SKY_M": SKY_M,
        "FOG_FLOOR_M": FOG_FLOOR_M,
        "MOTTLE_UP": mottle.UP,
        "MOTTLE_STEEP": mottle.STEEP,
        "MOTTLE_SEEN": mottle.SEEN,
        "MOTTLE_CYCLES_PER_M": mottle.CYCLES_PER_M,
        "MOTTLE_GAINS": mottle.GAINS,
        "MOTTLE_WEAR_PER_M": mottle.WEAR_PER_M,
        "MOTTLE_WEAR_SHIFT": mottle.WEAR_SHIFT,
        "TONE_SHOULDER": TONE_SHOULDER,
        "TONE_PER_ROOM": math.log2(math.e) / TONE_ROOM,
    }
    bells = zip(("NARROW", "WIDE", "FLOOR", "HAZE"), (*LOW_BEAM_BELLS, LOW_BEAM_HAZE), strict=True)
    for name, (cd, right_deg, up_deg, per_right, per_up) in bells:
        values[f"LOW_BEAM_{name}_CD"] = cd
        values[f"LOW_BEAM_{name}_DEG"] = (right_deg, up_deg)
        values[f"LOW_BEAM_{name}_PER_DEG"] = (per_right, per_up)
    whole = (f"LIST_COLUMNS {LIST_COLUMNS}u", f"LIGHT_TEXELS {TEXELS}")
    return (*(f"{name} {glsl(value)}" for name, value in values.items()), *whole)
