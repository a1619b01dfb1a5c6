"""Kernel of the event camera: all pixels of a band of rows between two pictures.

A pixel's signal is sampled at every `step_px` of motion, sixteen pixels of a tile at once. Where it
comes from in both pictures is looked for at every sample near edges of depth; in smooth tiles that
is done for the four corners only, at the ends of chunks of samples.
"""

from __future__ import annotations

from typing import Any

from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.event_camera.edge_tiles import fire_alone
from carlaloc_env.sensors.event_camera.simd_state import reaches
from carlaloc_env.sensors.event_camera.smooth_tiles import fire_smooth
from carlaloc_env.sensors.event_camera.threshold_crossings import (
    COUNT,
    EVENTS,
    NEXT_SHOT,
    PIXEL_ROWS,
    put_down,
    take_up,
)
from carlaloc_env.sensors.event_camera.tile_motion import tile_bounds, tile_knots, tile_steps
from carlaloc_env.sensors.imaging.motion_field import TILE_PX


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
    passing = fields[2]
    span_us, refractory_us, leaks, step_px = numbers
    knots, bounds, lanes, marks = scratch
    height, width = pictures[0].shape
    for row in range(first // TILE_PX, (end + TILE_PX - 1) // TILE_PX):
        marks[COUNT, NEXT_SHOT] = noise[3][row]
        for column in range(passing.shape[1]):
            y0, x0 = row * TILE_PX, column * TILE_PX
            y1, x1 = min(y0 + TILE_PX, height) - 1, min(x0 + TILE_PX, width) - 1
            corners = (y0, x0, y1, x1)
            steps, low, high = _prepared(pictures, fields, step_px, row, column, corners, scratch)
            smooth = steps > 0
            for y in range(y0, y1 + 1, PIXEL_ROWS):
                if not smooth:
                    # Beside an edge sixteen pixels may still move smoothly.
                    corners = (y, x0, min(y + PIXEL_ROWS - 1, y1), x1)
                    steps, low, high = _prepared(pictures, fields, step_px, row, column, corners, scratch)
                take_up(pictures, device, noise, leaks, corners, y, lanes, marks)
                if steps == 0:
                    fire_alone(pictures, fields, noise, numbers, row, column, lanes, marks, out_t, out_code)
                elif reaches(low, high, lanes) != 0:
                    fire_smooth(pictures, noise, numbers, knots, bounds, steps, lanes, marks, out_t, out_code)
                put_down(device, noise, span_us, refractory_us, corners, y, lanes, marks, out_t, out_code)
    count: int = marks[COUNT, EVENTS]
    return count


@inlined
def _prepared(
    pictures: Any, fields: Any, step_px: Any, row: int, column: int, corners: Any, scratch: Any
) -> Any:
    """Number of samples of pixels that move smoothly, 0 where they do not; the intensities they can meet."""
    before, _, ranges_before, ranges_after, _, _ = pictures
    knots, bounds, lanes, _ = scratch
    y0, x0, y1, x1 = corners
    low, high = before[y0, x0], before[y0, x0]
    steps = tile_steps(fields, row, column, y0, x0, y1, x1, step_px)
    if steps > 1 and not tile_knots(fields, corners, steps, knots, bounds, lanes):
        steps = 0
    if steps > 0:
        low, high = tile_bounds(ranges_before, ranges_after, row, column, knots, steps, bounds)
    return steps, low, high
