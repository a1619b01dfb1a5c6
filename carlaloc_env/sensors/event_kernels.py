"""Kernel of the event camera: all pixels of a band of rows between two pictures.

A pixel's signal is sampled at every `step_px` of motion. Where it comes from in both pictures is
looked for at the ends of chunks of samples; in between it moves straight on. In smooth tiles that
is done for the four corners only. Chunks whose surroundings hold no intensity beyond the pixel's
thresholds are passed over.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.compiled import compiled
from carlaloc_env.sensors.event_alone import fire_alone
from carlaloc_env.sensors.event_crossing import NEVER_US, shots_until
from carlaloc_env.sensors.event_signal import fire_tile
from carlaloc_env.sensors.event_tiles import tile_bounds, tile_knots, tile_steps
from carlaloc_env.sensors.pixel_motion import TILE_PX


@compiled
def fire_rows(
    pictures: Any,
    fields: Any,
    device: Any,
    noise: Any,
    numbers: Any,
    scratch: Any,
    out_t: Any,
    out_code: Any,
    first: int,
    end: int,
) -> int:
    """Events of a band of rows, whole tiles, tile by tile; the number there is room for is kept.

    Returns:
        Number of events, more than `out_t` is long if there was too little room.
    """
    before, _, ranges_before, ranges_after = pictures
    passing = fields[2]
    reference_in, last_in, reference_out, last_out = device[2:]
    span_us, refractory_us, leaks, step_px = numbers
    knots, bounds, levels = scratch
    height, width = before.shape
    count = 0
    for row in range(first // TILE_PX, (end + TILE_PX - 1) // TILE_PX):
        shot = noise[3][row]
        for column in range(passing.shape[1]):
            y0, x0 = row * TILE_PX, column * TILE_PX
            y1, x1 = min(y0 + TILE_PX, height) - 1, min(x0 + TILE_PX, width) - 1
            steps = tile_steps(fields, row, column, y0, x0, y1, x1, step_px)
            if steps > 1 and not tile_knots(fields, y0, x0, y1, x1, steps, knots, bounds):
                steps = 0
            if steps > 0:
                low, high = tile_bounds(ranges_before, ranges_after, row, column, knots, steps, bounds)
                corners = (y0, x0, y1, x1, low, high)
                shot, count = fire_tile(
                    pictures,
                    device,
                    noise,
                    numbers,
                    knots,
                    bounds,
                    levels,
                    corners,
                    steps,
                    shot,
                    count,
                    out_t,
                    out_code,
                )
                continue
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    on, off = device[0][y, x], device[1][y, x]
                    memory = (reference_in[y, x], np.int64(last_in[y, x]), shot, count)
                    memory = fire_alone(
                        pictures, fields, noise, numbers, on, off, y, x, levels, memory, out_t, out_code
                    )
                    reference, last, shot, count = shots_until(
                        noise, refractory_us, y * width + x, span_us, memory, out_t, out_code
                    )
                    reference_out[y, x] = reference - leaks * on
                    last_out[y, x] = max(last - span_us, NEVER_US)
    return count
