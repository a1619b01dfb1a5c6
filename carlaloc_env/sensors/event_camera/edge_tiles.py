"""Kernel of the event camera: the signal of pixels near edges of depth, looked for at every sample."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from carlaloc_env.core.jit import inlined
from carlaloc_env.sensors.event_camera.edge_search import (
    AT,
    FIRST_WAY,
    HELD,
    KNOWN,
    LAST_AT,
    MENDED,
    MISS,
    OVER_WAY,
    OWN,
    SECOND_WAY,
    STEP,
    THROUGH,
    WHEN,
    cover,
    decide,
    fill,
    go_on,
    mend,
    search,
    see,
)
from carlaloc_env.sensors.event_camera.simd import LANES
from carlaloc_env.sensors.event_camera.simd_state import CHUNK, LEVELS, U, V, arrive, repeat
from carlaloc_env.sensors.event_camera.threshold_crossings import fire_samples, settle
from carlaloc_env.sensors.event_camera.tile_motion import STEPS_MAX
from carlaloc_env.sensors.imaging.motion_field import SURFACE_RATIO

_ONE, _ZERO = np.float32(1), np.float32(0)


@inlined
def fire_alone(
    pictures: Any,
    fields: Any,
    noise: Any,
    numbers: Any,
    row: int,
    column: int,
    lanes: Any,
    marks: Any,
    out_t: Any,
    out_code: Any,
) -> None:
    """Events of sixteen pixels of a tile where surfaces hide each other."""
    before, _, _, _, flat_before, flat_after = pictures
    forward, backward, passing, flat_forward, flat_backward = fields
    span_us, refractory_us, _, step_px = numbers
    height, width = np.int32(before.shape[0]), np.int32(before.shape[1])
    over = passing[row, column]
    steps, through = _begin(forward, backward, over, step_px, lanes)
    per_step, sample_us = _ONE / np.float32(steps), np.float64(span_us) / np.float64(steps)
    if steps > 1:
        fill(np.int32(SECOND_WAY + WHEN), _ONE, lanes)
        search(flat_backward, width, height, SECOND_WAY, lanes)
        decide(_ZERO, lanes)
    sample = 0
    for k in range(1, steps):
        s = np.float32(k) * per_step
        fill(np.int32(FIRST_WAY + WHEN), s, lanes)
        fill(np.int32(SECOND_WAY + WHEN), _ONE - s, lanes)
        # What was lost is sought by turns where it led last, and as the pixel itself moves.
        for way in (FIRST_WAY, SECOND_WAY):
            go_on(np.int32(way), np.float32(k & 1), lanes)
        search(flat_forward, width, height, FIRST_WAY, lanes)
        search(flat_backward, width, height, SECOND_WAY, lanes)
        decide(s, lanes)
        if through:
            _search_over(flat_forward, width, height, np.float32(SURFACE_RATIO) * over[3], s, lanes)
            cover(lanes)
        sample += 1
        see(flat_before, flat_after, width, height, s, np.int32(sample), lanes)
        if sample == CHUNK:
            fire_samples(
                sample, k - sample, noise, span_us, refractory_us, sample_us, lanes, marks, out_t, out_code
            )
            sample = 0
            repeat(np.int32(CHUNK), lanes)
    sample += 1
    arrive(np.int32(sample), lanes)
    fire_samples(
        sample, steps - sample, noise, span_us, refractory_us, sample_us, lanes, marks, out_t, out_code
    )
    settle(span_us, refractory_us, sample_us, lanes, marks, out_t, out_code)


@inlined
def _begin(forward: Any, backward: Any, over: Any, step_px: Any, lanes: Any) -> Any:
    """Places at the beginning; number of samples, and whether something nearer passes over a pixel.

    That is something which neither picture shows there.
    """
    height, width = forward.shape[0], forward.shape[1]
    length, through = _ZERO, False
    for lane in range(LANES):
        x = min(int(lanes[U * LANES + lane]), width - 1)
        y = min(int(lanes[V * LANES + lane]), height - 1)
        ahead, back = forward[y, x], backward[y, x]
        length = max(length, max(max(abs(ahead[0]), abs(ahead[1])), max(abs(back[0]), abs(back[1]))))
        own = min(min(ahead[3], ahead[3] * ahead[2]), min(back[3], back[3] * back[2]))
        crossed = over[3] > 0 and min(over[3], over[3] * over[2]) < np.float32(0.8) * own
        through = through or crossed
        lanes[THROUGH * LANES + lane] = np.float32(crossed)
        lanes[(OVER_WAY + KNOWN) * LANES + lane] = np.float32(crossed)
        lanes[HELD * LANES + lane] = lanes[LEVELS * LANES + lane]
        for part in range(2):
            at = lanes[(U if part == 0 else V) * LANES + lane]
            lanes[(FIRST_WAY + AT + part) * LANES + lane] = at
            lanes[(SECOND_WAY + AT + part) * LANES + lane] = at + ahead[part]
            lanes[(FIRST_WAY + STEP + part) * LANES + lane] = back[part]
            lanes[(SECOND_WAY + STEP + part) * LANES + lane] = -ahead[part]
        for part in range(3):
            lanes[(FIRST_WAY + OWN + part) * LANES + lane] = ahead[part]
            lanes[(SECOND_WAY + OWN + part) * LANES + lane] = back[part]
            lanes[(OVER_WAY + OWN + part) * LANES + lane] = over[part]
        lanes[(FIRST_WAY + KNOWN) * LANES + lane] = _ONE
        lanes[(SECOND_WAY + KNOWN) * LANES + lane] = _ONE
    if through:
        length = max(length, max(abs(over[0]), abs(over[1])))
    steps = min(max(math.ceil(length / step_px), 1), STEPS_MAX)
    for part in range(STEP, STEP + 2):
        for lane in range(LANES):
            lanes[(FIRST_WAY + part) * LANES + lane] /= np.float32(steps)
            lanes[(SECOND_WAY + part) * LANES + lane] /= np.float32(steps)
    # So that the first step of all goes on from here as it is thought to.
    for lane in range(LANES):
        lanes[(FIRST_WAY + MISS) * LANES + lane] = _ZERO
        for part in range(2):
            at, step = (
                lanes[(FIRST_WAY + AT + part) * LANES + lane],
                lanes[(FIRST_WAY + STEP + part) * LANES + lane],
            )
            lanes[(FIRST_WAY + LAST_AT + part) * LANES + lane] = at - step
    return steps, through


@inlined
def _search_over(field: Any, width: Any, height: Any, nearest: Any, s: Any, lanes: Any) -> None:
    """Look for what passes in front, in the first picture, where its own motion says."""
    fill(np.int32(OVER_WAY + WHEN), s, lanes)
    go_on(np.int32(OVER_WAY), np.float32(2), lanes)
    for _ in range(MENDED):
        if mend(field, width, height, np.int32(OVER_WAY), nearest, lanes) == 0:
            break
