"""Numbers that shaders share with Python, as defines: each has one owner, in Python."""

import math

from numpy.typing import ArrayLike

from carlaloc_env.render.geometry.material_tables import LOG_SCALE
from carlaloc_env.render.lighting.light_grid import SKY_M
from carlaloc_env.render.lighting.light_sources import LAMP_COLOUR, LAMP_LEAST_M
from carlaloc_env.render.lighting.light_table import LIST_COLUMNS, TEXELS
from carlaloc_env.render.lighting.lit_tiles import RETROREFLECTION
from carlaloc_env.render.lighting.low_beam import (
    LOW_BEAM_BELLS,
    LOW_BEAM_CUT_OFF,
    LOW_BEAM_DEGREES,
    LOW_BEAM_HAZE,
    LOW_BEAM_LEAST_AHEAD,
)
from carlaloc_env.render.lighting.mirror import SMEAR
from carlaloc_env.render.lighting.uniforms import FOG_FLOOR_M
from carlaloc_env.render.shader_programs import glsl
from carlaloc_env.road.wheel_tracks import TRACK_HALF_M, TRACK_M
from carlaloc_env.scene import mottle
from carlaloc_env.weather import snow_patches

TONE_SHOULDER, TONE_ROOM = 0.6, 0.4
"""Exposed light up to which the tone curve is straight, and what lies between it and white."""

SNOW_WHITE, SNOW_SLUSH = (0.86, 0.88, 0.90), (0.56, 0.55, 0.54)
"""Albedo of fresh snow (0.84 to 0.85 over the whole spectrum, more in the visible), and of driven snow."""


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
        "PATCH_COARSE": (snow_patches.COARSE_PER_M, snow_patches.COARSE_SHARE),
        "PATCH_FINE": (snow_patches.FINE_PER_M, snow_patches.FINE_SHIFT),
        "SNOW_WHITE": SNOW_WHITE,
        "SNOW_SLUSH": SNOW_SLUSH,
        "TRACK_M": TRACK_M,
        "TRACK_HALF_M": TRACK_HALF_M,
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
