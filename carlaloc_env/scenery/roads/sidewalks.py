"""Sidewalks and medians beside plain roads: kerb faces, kerb stones, slabs, grass, ends and outer edges."""

from collections.abc import Sequence

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude

KERB_STONE_M = 0.15
"""Width of the kerb stone's top [m]."""
BELOW_M = 0.06
"""How far kerb faces reach below the road surface [m]."""
LIP_M = 0.02
"""Height of a dropped kerb above the road [m]."""
RAMP_M, FLARE_M = 1.2, 0.8
"""Length of the ramp behind a dropped kerb, and of the slopes at its sides [m]."""
LONGEST_CROSSWALK_M = 12.0
"""Wider crosswalks are no crosswalks across the road [m]."""
BLISTER = (226.0, 198.0, 140.0)
"""Linear tint of the paving that warns the blind."""
GRASS_MEDIAN_M = 1.8
"""Medians of at least this width carry grass [m]."""


def add_sidewalks(out: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road], seed: int) -> None:
    """Adds sidewalks and medians beside the roads outside junctions, with kerbs dropped at crosswalks."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        draw = clock.stream(seed, f"pavement/{strip.road_id}/{strip.section}")
        shade = draw.uniform(205, 250)
        spans = [
            (item.s_m - 0.5 * item.length_m, item.s_m + 0.5 * item.length_m)
            for item in roads[strip.road].objects
            if item.type == "crosswalk" and item.length_m < LONGEST_CROSSWALK_M
        ]
        for first, last in raised_runs(strip):
            _raised_run(out, strip, first, last, (shade, shade * 0.99, shade * 0.97), spans)


def raised_runs(strip: Strip) -> list[tuple[int, int]]:
    """First and last lane of each run of neighbouring raised lanes of one kind."""
    runs: list[tuple[int, int]] = []
    for lane in range(len(strip.lanes)):
        if strip.kind(lane) not in ("sidewalk", "median"):
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
    out: MeshBuilder,
    strip: Strip,
    first: int,
    last: int,
    colour: tuple[float, float, float],
    spans: Sequence[tuple[float, float]],
) -> None:
    left, right = run_edges(strip, first, last)
    if np.linalg.norm((left - right)[:, :2], axis=1).max() < 0.02:
        return
    kerb_left = first > 0 and strip.kind(first - 1) == "roadway"
    kerb_right = last < len(strip.lanes) - 1 and strip.kind(last + 1) == "roadway"
    s, near = _with_ramps(strip.s_m, spans)
    left, right = interpolated(s, strip.s_m, left), interpolated(s, strip.s_m, right)
    width = np.linalg.norm((left - right)[:, :2], axis=1)
    median = strip.kind(first) == "median"
    grass = median and width.mean() >= GRASS_MEDIAN_M
    material = Material.GRASS if grass else Material.PAVEMENT
    tag = Tag.TERRAIN if grass else Tag.SIDEWALK
    tint = np.array((235.0, 235.0, 235.0) if grass else colour)
    inner = []
    # Bands name their left line first: the outer one, or on the right side the inner one.
    for edge, other, side, kerb in ((left, right, 1, kerb_left), (right, left, -1, kerb_right)):
        raised = np.interp(s, strip.s_m, strip.raised_m[first if side > 0 else last, 0 if side > 0 else 1])
        low = edge.copy()
        low[:, 2] -= raised + BELOW_M + (0.0 if kerb else 0.25)
        within = edge
        if kerb:
            stone = np.minimum(KERB_STONE_M / np.maximum(width, 1e-6), 0.5)[:, None]
            within = edge + (other - edge) * stone
            if near.any():
                share = np.minimum((KERB_STONE_M + RAMP_M) / np.maximum(width, 1e-6), 0.5)[:, None]
                deep = edge + (other - edge) * share
                fall = np.zeros_like(edge)
                fall[:, 2] = np.maximum(raised - LIP_M, 0.0) * near
                edge, within = edge - fall, within - fall
                warn = np.where((near > 0.999)[:, None], np.array(BLISTER), tint)
                _top(out, s, (within, deep)[::side], material, tag, tint if grass else warn[:, None])
            _top(out, s, (edge, within)[::side], Material.KERB, Tag.SIDEWALK, np.array((225.0, 225.0, 222.0)))
            inner.append(deep if near.any() else within)
        else:
            inner.append(edge)
        line, top = (low[::-1], edge[::-1]) if side > 0 else (low, edge)
        face = Material.KERB if kerb else Material.CONCRETE
        corners, uv = extrude(line, top)
        out.quads(corners, uv_m=uv, material=face, tag=Tag.SIDEWALK, colour=(215, 215, 212))
    _top(out, s, (inner[0], inner[1]), material, tag, tint)
    _ends(out, left, right)


def _with_ramps(s_m: Array, spans: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    """Stations with those where dropped kerbs begin and end, and how far the kerb is down there, 0 to 1."""
    extra = [at for low, high in spans for at in (low - FLARE_M, low, high, high + FLARE_M)]
    s = np.unique(np.concatenate([s_m, [at for at in extra if s_m[0] + 1e-3 < at < s_m[-1] - 1e-3]]))
    down = np.zeros(len(s))
    for low, high in spans:
        gap = np.maximum(np.maximum(low - s, s - high), 0.0)
        down = np.maximum(down, np.clip(1.0 - gap / FLARE_M, 0.0, 1.0))
    # Ends stay up: the next strip, or the corner of the junction, knows of no ramp.
    if len(down):
        down[[0, -1]] = 0.0
    return s, down


def _top(
    out: MeshBuilder, s: Array, sides: tuple[Array, ...], material: Material, tag: Tag, colour: Array
) -> None:
    """A band between its left and its right side."""
    left, right = sides
    width = np.linalg.norm((left - right)[:, :2], axis=1)
    uv = np.stack([np.stack([np.zeros_like(width), s], -1), np.stack([width, s], -1)], axis=1)
    out.grid(np.stack([right, left], axis=1), material=material, tag=tag, uv_m=uv, colour=colour)


def _ends(out: MeshBuilder, left: Array, right: Array) -> None:
    """Upright faces at the first and last station; hidden where the sidewalk goes on."""
    down = np.array([0.0, 0.0, 0.25])
    for a, b in ((left[0], right[0]), (right[-1], left[-1])):
        if np.hypot(*(a - b)[:2]) > 0.02:
            quad = np.array([[a - down, b - down, b, a]])
            out.quads(quad, material=Material.KERB, tag=Tag.SIDEWALK, colour=(215, 215, 212))
