"""Pavements and medians beside plain roads: kerb faces, kerb stones, slabs, grass, ends and outer edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.materials import Material
from carlaloc_env.semantics import Tag
from carlaloc_env.town.meshing import MeshBuilder, extrude
from carlaloc_env.town.sections import Strip

Array = NDArray[np.float64]

KERB_STONE_M = 0.15
"""Width of the kerb stone's top [m]."""
BELOW_M = 0.06
"""How far kerb faces reach below the road surface [m]."""
GRASS_MEDIAN_M = 1.8
"""Medians of at least this width carry grass [m]."""


def add_pavements(out: MeshBuilder, strips: Sequence[Strip], seed: int) -> None:
    """Everything raised beside the roads outside junctions."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        draw = rng.stream(seed, f"pavement/{strip.road_id}/{strip.section}")
        shade = draw.uniform(205, 250)
        for first, last in raised_runs(strip):
            _raised_run(out, strip, first, last, (shade, shade * 0.99, shade * 0.97))


def raised_runs(strip: Strip) -> list[tuple[int, int]]:
    """First and last lane of each run of neighbouring raised lanes of one kind."""
    runs: list[tuple[int, int]] = []
    for lane in range(len(strip.lanes)):
        if strip.kind(lane) not in ("walkway", "median"):
            continue
        if runs and runs[-1][1] == lane - 1 and strip.kind(lane - 1) == strip.kind(lane):
            runs[-1] = (runs[-1][0], lane)
        else:
            runs.append((lane, lane))
    return runs


def run_edges(strip: Strip, first: int, last: int) -> tuple[Array, Array]:
    """Left and right top edge of a run of raised lanes [m], (N, 3) each."""
    return strip.lane_edges(first)[0], strip.lane_edges(last)[1]


def _raised_run(
    out: MeshBuilder, strip: Strip, first: int, last: int, colour: tuple[float, float, float]
) -> None:
    left, right = run_edges(strip, first, last)
    width = np.linalg.norm((left - right)[:, :2], axis=1)
    if width.max() < 0.02:
        return
    kerb_left = first > 0 and strip.kind(first - 1) == "roadway"
    kerb_right = last < len(strip.lanes) - 1 and strip.kind(last + 1) == "roadway"
    stone = np.minimum(KERB_STONE_M / np.maximum(width, 1e-6), 0.5)[:, None]
    across = right - left
    a = left + across * stone if kerb_left else left
    b = right - across * stone if kerb_right else right
    median = strip.kind(first) == "median"
    grass = median and width.mean() >= GRASS_MEDIAN_M
    material = Material.GRASS if grass else Material.PAVEMENT
    tag = Tag.TERRAIN if grass else Tag.SIDEWALK
    _top(out, strip, a, b, material, tag, (235.0, 235.0, 235.0) if grass else colour)
    for edge, inner, side, kerb in ((left, a, 1, kerb_left), (right, b, -1, kerb_right)):
        outer, within = (edge, inner) if side > 0 else (inner, edge)
        if kerb:
            _top(out, strip, outer, within, Material.KERB, Tag.SIDEWALK, (225.0, 225.0, 222.0))
        low = edge.copy()
        lane = first if side > 0 else last
        low[:, 2] -= strip.raised_m[lane, 0 if side > 0 else 1] + BELOW_M + (0.0 if kerb else 0.25)
        line, top = (low[::-1], edge[::-1]) if side > 0 else (low, edge)
        face = Material.KERB if kerb else Material.CONCRETE
        corners, uv = extrude(line, top)
        out.quads(corners, uv_m=uv, material=face, tag=Tag.SIDEWALK, colour=(215, 215, 212))
    _ends(out, left, right)


def _top(
    out: MeshBuilder,
    strip: Strip,
    left: Array,
    right: Array,
    material: Material,
    tag: Tag,
    colour: tuple[float, float, float],
) -> None:
    width = np.linalg.norm((left - right)[:, :2], axis=1)
    uv = np.stack([np.stack([np.zeros_like(width), strip.s_m], -1), np.stack([width, strip.s_m], -1)], axis=1)
    out.grid(np.stack([right, left], axis=1), material=material, tag=tag, uv_m=uv, colour=colour)


def _ends(out: MeshBuilder, left: Array, right: Array) -> None:
    """Upright faces at the first and last station; hidden where the pavement goes on."""
    down = np.array([0.0, 0.0, 0.25])
    for a, b in ((left[0], right[0]), (right[-1], left[-1])):
        if np.hypot(*(a - b)[:2]) > 0.02:
            quad = np.array([[a - down, b - down, b, a]])
            out.quads(quad, material=Material.KERB, tag=Tag.SIDEWALK, colour=(215, 215, 212))
