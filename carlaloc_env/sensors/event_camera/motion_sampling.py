"""The signal of a pixel between two pictures: log intensity along the true motion of what it sees.

At time s of the span, 0 to 1, both pictures are looked up where they show what the pixel sees then,
and blended: (1 − s) of the first and s of the second; what only one of them shows comes from that
one. In smooth tiles these places lie between those of the corners; near edges of depth they are
searched for.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.event_camera.tile_survey import CHUNK, depth_of, is_nearer, own_places
from carlaloc_env.sensors.imaging.motion_field import SURFACE_RATIO, TILE_PX, bilinear, source_of
from carlaloc_env.sensors.imaging.motion_warping import BOTH, FIRST, MISS_PX, NOWHERE, SECOND, Sight, sources

SEARCH_STEPS = 4
"""Samples between two places that are searched for; in between only where the surface changes."""
_ONE, _ZERO = np.float32(1), np.float32(0)


@inlined
def sample_signal(
    pictures: Any, fields: Any, tile: Any, motion: Any, notes: Any, y: int, x: int, k: int, levels: Any
) -> int:
    """Log intensity of a pixel at all samples of chunk k, from its beginning to its end.

    Args:
        pictures: Both pictures.
        fields: Motion of all pixels.
        tile: Tile of the pixel.
        motion: Its motion, from `survey`.
        notes: What `survey` noted of it.
        y: Row of the pixel.
        x: Column.
        k: Number of the chunk.
        levels: Filled in; shape (CHUNK + 1,).

    Returns:
        Steps of the chunk: one less than samples.
    """
    begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, motion.steps)
    if motion.steps == 1:
        levels[0] = pictures.before[y, x]
    elif motion.smooth:
        _sample_smooth(pictures, tile, notes, y, x, motion.steps, k, levels)
    else:
        _sample_by_search(pictures, fields, y, x, motion.steps, k, levels)
    if motion.crossed:
        _cover(pictures, fields, y, x, motion.steps, k, levels)
    if stop == motion.steps:
        levels[stop - begin] = pictures.after[y, x]
    count: int = stop - begin
    return count


@inlined
def _sample_smooth(
    pictures: Any, tile: Any, notes: Any, y: int, x: int, steps: int, k: int, levels: Any
) -> None:
    """Signal of a pixel of a smooth tile at the samples of chunk k, from its beginning to its end."""
    begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
    along = np.float32(x - tile.x0) / np.float32(max(tile.x1 - tile.x0, 1))
    down = np.float32(y - tile.y0) / np.float32(max(tile.y1 - tile.y0, 1))
    ax, ay, bx, by = _place(notes.corners[k], along, down)
    ex, ey, fx, fy = _place(notes.corners[k + 1], along, down)
    share, per_step = _ONE / np.float32(stop - begin), _ONE / np.float32(steps)
    picture, more, grows = pictures.before, _ZERO, _ZERO
    if notes.seen_in[k] == BOTH and notes.seen_in[k + 1] == BOTH:
        # The picture nearer in time is followed; by how much the blend differs from it goes linearly.
        difference = bilinear(pictures.after, bx, by) - bilinear(pictures.before, ax, ay)
        later = bilinear(pictures.after, fx, fy) - bilinear(pictures.before, ex, ey)
        s0, s1 = np.float32(begin) * per_step, np.float32(stop) * per_step
        if begin + stop > steps:
            picture, ax, ay, ex, ey = pictures.after, bx, by, fx, fy
            s0, s1 = s0 - _ONE, s1 - _ONE
        more, grows = s0 * difference, share * (s1 * later - s0 * difference)
    dx, dy = share * (ex - ax), share * (ey - ay)
    for j in range(np.uint32(stop - begin + 1)):
        f = np.float32(j)
        levels[j] = bilinear(picture, ax + f * dx, ay + f * dy) + (more + f * grows)


@inlined
def _place(corners: Any, along: Any, down: Any) -> Any:
    """Places in both pictures between those of a tile's corners."""
    w0, w1 = (_ONE - along) * (_ONE - down), along * (_ONE - down)
    w2, w3 = (_ONE - along) * down, along * down
    return (
        w0 * corners[0, 0] + w1 * corners[1, 0] + w2 * corners[2, 0] + w3 * corners[3, 0],
        w0 * corners[0, 1] + w1 * corners[1, 1] + w2 * corners[2, 1] + w3 * corners[3, 1],
        w0 * corners[0, 2] + w1 * corners[1, 2] + w2 * corners[2, 2] + w3 * corners[3, 2],
        w0 * corners[0, 3] + w1 * corners[1, 3] + w2 * corners[2, 3] + w3 * corners[3, 3],
    )


@compiled
def _sample_by_search(pictures: Any, fields: Any, y: int, x: int, steps: int, k: int, levels: Any) -> None:
    """Signal of a pixel near edges of depth at the samples of chunk k, from its beginning to its end."""
    begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
    forward, backward = fields.forward, fields.backward
    u, v, per_step = np.float32(x), np.float32(y), _ONE / np.float32(steps)
    s = np.float32(begin) * per_step
    ax, ay, bx, by = own_places(fields, y, x, s)
    here = sources(forward, backward, u, v, s, ax, ay, bx, by)
    levels[0] = _blended(pictures, y, x, s, here)
    way = _own_way(fields, y, x)
    for first in range(begin, stop, SEARCH_STEPS):
        last = min(first + SEARCH_STEPS, stop)
        s, ds = np.float32(last) * per_step, np.float32(last - first) * per_step
        there = sources(
            forward, backward, u, v, s,
            here.ax + ds * way[0], here.ay + ds * way[1], here.bx + ds * way[2], here.by + ds * way[3],
        )  # fmt: skip
        levels[last - begin] = _blended(pictures, y, x, s, there)
        straight = here.seen_in == there.seen_in and here.seen_in != NOWHERE
        for j in range(first + 1, last):
            s, f = np.float32(j) * per_step, np.float32(j - first) / np.float32(last - first)
            between = Sight(
                here.ax + f * (there.ax - here.ax),
                here.ay + f * (there.ay - here.ay),
                here.bx + f * (there.bx - here.bx),
                here.by + f * (there.by - here.by),
                here.seen_in,
            )
            if not straight:
                between = sources(forward, backward, u, v, s, between.ax, between.ay, between.bx, between.by)
            levels[j - begin] = _blended(pictures, y, x, s, between)
        way = _own_way(fields, y, x)
        if straight:
            way = (
                (there.ax - here.ax) / ds,
                (there.ay - here.ay) / ds,
                (there.bx - here.bx) / ds,
                (there.by - here.by) / ds,
            )
        here = there


@inlined
def _own_way(fields: Any, y: int, x: int) -> Any:
    """How places in both pictures move over the span, if all around moves as the pixel itself does [px]."""
    ahead, back = fields.forward[y, x], fields.backward[y, x]
    return back[0], back[1], -ahead[0], -ahead[1]


@inlined
def _blended(pictures: Any, y: int, x: int, s: Any, sight: Any) -> Any:
    """Log intensity at time s of what a pixel sees; where neither picture shows it, of the pixel itself."""
    if sight.seen_in == BOTH:
        first = bilinear(pictures.before, sight.ax, sight.ay)
        return first + s * (bilinear(pictures.after, sight.bx, sight.by) - first)
    if sight.seen_in == FIRST:
        return bilinear(pictures.before, sight.ax, sight.ay)
    if sight.seen_in == SECOND:
        return bilinear(pictures.after, sight.bx, sight.by)
    return pictures.before[y, x] + s * (pictures.after[y, x] - pictures.before[y, x])


@compiled
def _cover(pictures: Any, fields: Any, y: int, x: int, steps: int, k: int, levels: Any) -> None:
    """Put into the samples of chunk k what a surface shows that passes in front of the pixel meanwhile.

    Neither picture may show it there: a pole that sweeps past.
    """
    begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
    forward, u, v = fields.forward, np.float32(x), np.float32(y)
    over = fields.passing[y // TILE_PX, x // TILE_PX]
    depth_m = depth_of(fields, y, x)
    if not is_nearer(over, depth_m):
        return
    for j in range(begin, stop + 1):
        s = np.float32(j) / np.float32(steps)
        tau = s * over[2] / ((_ONE - s) + s * over[2])
        ax, ay = u - tau * over[0], v - tau * over[1]
        if _shows(forward, ax, ay, over[3]):
            ax, ay, depth, miss = source_of(forward, u, v, s, ax, ay)
            if miss < MISS_PX and depth < np.float32(0.9) * depth_m:
                levels[j - begin] = bilinear(pictures.before, ax, ay)


@inlined
def _shows(field: Any, x: Any, y: Any, depth_m: Any) -> bool:
    """Whether a picture shows something about as near as a depth [m] at a place."""
    i, j = int(x), int(y)
    if x < 0 or y < 0 or i > field.shape[1] - 2 or j > field.shape[0] - 2:
        return False
    nearest = min(min(field[j, i, 3], field[j, i + 1, 3]), min(field[j + 1, i, 3], field[j + 1, i + 1, 3]))
    found: bool = nearest < np.float32(SURFACE_RATIO) * depth_m
    return found
