"""The signal of a pixel between two pictures: log intensity along the true motion of what it sees.

At time s of the span, 0 to 1, both pictures are looked up where they show what the pixel sees then,
and blended: (1 − s) of the first and s of the second; what only one of them shows comes from that
one. In smooth tiles these places lie between those of the corners; near edges of depth they are
searched for.
"""

from typing import Any, NamedTuple

import numpy as np

from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.event_camera.tile_survey import CHUNK, ONE, ZERO, depth_of, is_nearer, own_places
from carlaloc_env.sensors.imaging.motion_field import SURFACE_RATIO, TILE_PX, bilinear, source_of
from carlaloc_env.sensors.imaging.shutter import (
    BOTH,
    FIRST,
    MISS_PX,
    SECOND,
    sources,
)

BEND = np.float32(0.25)
"""Motion of one surface differs by less between the places that a pixel sees one sample apart [px]."""
COVERS = np.float32(0.9)
"""What a surface hides at one moment is farther away by this ratio."""


class Track(NamedTuple):
    """Places of a pixel's surface at the samples of a chunk: arrays that are used again and again."""

    places: Any
    """Places in both pictures (x, y, x, y) [px], shape (CHUNK + 1, 4)."""
    seen_in: Any
    """Which pictures show it, shape (CHUNK + 1,)."""


def new_track() -> Track:
    """Arrays for one chunk."""
    return Track(places=np.zeros((CHUNK + 1, 4), np.float32), seen_in=np.zeros(CHUNK + 1, np.int64))


@inlined
def sample_signal(
    pictures: Any,
    fields: Any,
    tile: Any,
    motion: Any,
    notes: Any,
    y: int,
    x: int,
    k: int,
    track: Any,
    levels: Any,
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
        track: Room for the places at all samples.
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
        _sample_by_search(pictures, fields, y, x, motion.steps, k, track, levels)
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
    share, per_step = ONE / np.float32(stop - begin), ONE / np.float32(steps)
    picture, offset, growth = pictures.before, ZERO, ZERO
    if notes.seen_in[k] == BOTH and notes.seen_in[k + 1] == BOTH:
        # The picture nearer in time is followed; its difference from the blend changes linearly.
        difference = bilinear(pictures.after, bx, by) - bilinear(pictures.before, ax, ay)
        later = bilinear(pictures.after, fx, fy) - bilinear(pictures.before, ex, ey)
        s0, s1 = np.float32(begin) * per_step, np.float32(stop) * per_step
        if begin + stop > steps:
            picture, ax, ay, ex, ey = pictures.after, bx, by, fx, fy
            s0, s1 = s0 - ONE, s1 - ONE
        offset, growth = s0 * difference, share * (s1 * later - s0 * difference)
    dx, dy = share * (ex - ax), share * (ey - ay)
    for j in range(np.uint32(stop - begin + 1)):
        f = np.float32(j)
        levels[j] = bilinear(picture, ax + f * dx, ay + f * dy) + (offset + f * growth)


@inlined
def _place(corners: Any, along: Any, down: Any) -> Any:
    """Places in both pictures between those of a tile's corners."""
    w0, w1 = (ONE - along) * (ONE - down), along * (ONE - down)
    w2, w3 = (ONE - along) * down, along * down
    return (
        w0 * corners[0, 0] + w1 * corners[1, 0] + w2 * corners[2, 0] + w3 * corners[3, 0],
        w0 * corners[0, 1] + w1 * corners[1, 1] + w2 * corners[2, 1] + w3 * corners[3, 1],
        w0 * corners[0, 2] + w1 * corners[1, 2] + w2 * corners[2, 2] + w3 * corners[3, 2],
        w0 * corners[0, 3] + w1 * corners[1, 3] + w2 * corners[2, 3] + w3 * corners[3, 3],
    )


@compiled
def _sample_by_search(
    pictures: Any, fields: Any, y: int, x: int, steps: int, k: int, track: Any, levels: Any
) -> None:
    """Signal of a pixel near edges of depth at the samples of chunk k, from its beginning to its end.

    Places are searched for at both ends, and by halves where it does not see the same surface all the time.
    """
    begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
    per_step = ONE / np.float32(steps)
    for j in (begin, stop):
        s = np.float32(j) * per_step
        _search(fields, y, x, s, own_places(fields, y, x, s), track, j - begin)
    size = CHUNK
    while size > 1:
        for first in range(0, stop - begin, size):
            last, middle = min(first + size, stop - begin), first + size // 2
            if middle < last:
                guess = _between(track.places[first], track.places[last], (middle - first) / (last - first))
                if _is_same_surface(track, first, last):
                    _note(track, middle, guess, track.seen_in[first])
                else:
                    _search(fields, y, x, np.float32(begin + middle) * per_step, guess, track, middle)
        size //= 2
    for j in range(stop - begin + 1):
        s = np.float32(begin + j) * per_step
        levels[j] = _blended(pictures, y, x, s, track.seen_in[j], track.places[j])


@inlined
def _search(fields: Any, y: int, x: int, s: Any, guess: Any, track: Any, j: int) -> None:
    """Note where what a pixel sees at time s lies in both pictures, from a guess."""
    u, v = np.float32(x), np.float32(y)
    ax, ay, bx, by, seen_in = sources(
        fields.forward, fields.backward, u, v, s, guess[0], guess[1], guess[2], guess[3]
    )
    _note(track, j, (ax, ay, bx, by), seen_in)


@inlined
def _note(track: Any, j: int, places: Any, seen_in: int) -> None:
    track.seen_in[j] = seen_in
    here = track.places[j]
    here[0], here[1], here[2], here[3] = places


@inlined
def _between(first: Any, last: Any, share: Any) -> Any:
    """Places between two others, at a share of the distance."""
    f = np.float32(share)
    return (
        first[0] + f * (last[0] - first[0]),
        first[1] + f * (last[1] - first[1]),
        first[2] + f * (last[2] - first[2]),
        first[3] + f * (last[3] - first[3]),
    )


@inlined
def _is_same_surface(track: Any, first: int, last: int) -> bool:
    """Whether a pixel seems to see one surface from one sample to another: the same pictures show it.

    If both do, its motion must be about the same, too.
    """
    if track.seen_in[first] != track.seen_in[last]:
        return False
    if track.seen_in[first] != BOTH:
        return True
    a, b = track.places[first], track.places[last]
    du, dv = (b[2] - b[0]) - (a[2] - a[0]), (b[3] - b[1]) - (a[3] - a[1])
    same: bool = max(abs(du), abs(dv)) <= ONE + BEND * np.float32(last - first)
    return same


@inlined
def _blended(pictures: Any, y: int, x: int, s: Any, seen_in: int, places: Any) -> Any:
    """Log intensity at time s of what a pixel sees; where neither picture shows it, of the pixel itself."""
    if seen_in == BOTH:
        first = bilinear(pictures.before, places[0], places[1])
        return first + s * (bilinear(pictures.after, places[2], places[3]) - first)
    if seen_in == FIRST:
        return bilinear(pictures.before, places[0], places[1])
    if seen_in == SECOND:
        return bilinear(pictures.after, places[2], places[3])
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
        tau = s * over[2] / ((ONE - s) + s * over[2])
        ax, ay = u - tau * over[0], v - tau * over[1]
        if _shows(forward, ax, ay, over[3]):
            ax, ay, depth, miss = source_of(forward, u, v, s, ax, ay)
            if miss < MISS_PX and depth < COVERS * depth_m:
                levels[j - begin] = bilinear(pictures.before, ax, ay)


@inlined
def _shows(field: Any, x: Any, y: Any, depth_m: Any) -> bool:
    """Whether a picture shows something about as near as a depth [m] at a place."""
    i, j = int(x), int(y)
    if x < 0 or y < 0 or i > field.shape[1] - 2 or j > field.shape[0] - 2:
        return False
    nearest = min(min(field[j, i, 3], field[j, i + 1, 3]), min(field[j + 1, i, 3], field[j + 1, i + 1, 3]))
    shown: bool = nearest < np.float32(SURFACE_RATIO) * depth_m
    return shown
