"""Lane geometry for compiled functions: points, widths, speeds and neighbouring stations of lanes."""

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads


@compiled
def sample(roads: Roads, lane: int, station_m: float) -> tuple[int, float]:
    """Row of the sample before a station [m], and the fraction of the distance to the next row, 0–1."""
    at = min(max(station_m / roads.lane.row_step_m[lane], 0.0), roads.lane.row_count[lane] - 1.0)
    k = min(int(at), roads.lane.row_count[lane] - 2)
    return roads.lane.row_first[lane] + k, at - k


@compiled
def allowed_at(roads: Roads, lane: int, station_m: float) -> float:
    """Speed that limit and bends allow at a station [m] of a lane [m/s]."""
    row, _ = sample(roads, lane, station_m)
    return float(roads.row.allowed_mps[row])


@compiled
def width_at(roads: Roads, lane: int, station_m: float) -> float:
    """Width of a lane at a station [m], linear between samples [m]."""
    row, f = sample(roads, lane, station_m)
    return float(roads.row.width_m[row] * (1.0 - f) + roads.row.width_m[row + 1] * f)


@compiled
def centre_at(roads: Roads, lane: int, station_m: float) -> tuple[float, float, float, float]:
    """Point (x, y) [m], cosine and sine of a lane's centre line, by straight lines between the samples."""
    row, f = sample(roads, lane, station_m)
    c = roads.row.tangent[row, 0] * (1.0 - f) + roads.row.tangent[row + 1, 0] * f
    s = roads.row.tangent[row, 1] * (1.0 - f) + roads.row.tangent[row + 1, 1] * f
    x = roads.row.position_m[row, 0] * (1.0 - f) + roads.row.position_m[row + 1, 0] * f
    y = roads.row.position_m[row, 1] * (1.0 - f) + roads.row.position_m[row + 1, 1] * f
    norm = np.sqrt(c * c + s * s)
    return float(x), float(y), float(c / norm), float(s / norm)


@compiled
def station_beside(roads: Roads, lane: int, station_m: float, other: int) -> float:
    """Station of a neighbouring lane of the same section that lies beside a station [m].

    Both have the same distance along the road's reference line, linear between samples.
    """
    row, f = sample(roads, lane, station_m)
    along = roads.row.along_m[row] * (1.0 - f) + roads.row.along_m[row + 1] * f
    first, last = roads.lane.row_first[other], roads.lane.row_first[other] + roads.lane.row_count[other] - 2
    past = row - roads.lane.row_first[lane] + f
    other_row = min(first + int(past * roads.lane.row_count[other] / roads.lane.row_count[lane]), last)
    while other_row > first and roads.row.along_m[other_row] > along:
        other_row -= 1
    while other_row < last and roads.row.along_m[other_row + 1] < along:
        other_row += 1
    gap = roads.row.along_m[other_row + 1] - roads.row.along_m[other_row]
    fraction = (along - roads.row.along_m[other_row]) / gap if gap > 1e-9 else 0.0
    beyond = station_m - min(max(station_m, 0.0), roads.lane.length_m[lane])
    return float((other_row - first + fraction) * roads.lane.row_step_m[other] + beyond)


@compiled
def bank_at(roads: Roads, lane: int, station_m: float) -> float:
    """Rise of the road per metre to the left of a lane at a station [m], linear between samples."""
    row, f = sample(roads, lane, station_m)
    return float(roads.row.bank[row] * (1.0 - f) + roads.row.bank[row + 1] * f)


@compiled
def put_point(roads: Roads, lane: int, station_m: float, lateral_offset_m: float, out: Array) -> None:
    """Write a point of a lane and its direction to `out`: x, y, z [m], cos, sin, rise.

    Args:
        roads: The roads.
        lane: The lane.
        station_m: Station [m]; beyond the lane's ends its end directions go on straight.
        lateral_offset_m: Distance to the left of the centre line [m].
        out: Six numbers.
    """
    row, f = sample(roads, lane, station_m)
    on_lane = min(max(station_m, 0.0), roads.lane.length_m[lane])
    g, h, f2 = 1.0 - f, roads.lane.row_step_m[lane], f * f
    w1 = f2 * (3.0 - 2.0 * f)
    m0, m1 = h * f * g * g, h * f2 * g
    for k in range(3):
        t0, t1 = roads.row.tangent[row, k], roads.row.tangent[row + 1, k]
        p0, p1 = roads.row.position_m[row, k], roads.row.position_m[row + 1, k]
        tangent = t0 * g + t1 * f
        out[k] = p0 * (1.0 - w1) + p1 * w1 + t0 * m0 - t1 * m1 + (station_m - on_lane) * tangent
        out[3 + k] = tangent
    norm = np.sqrt(out[3] * out[3] + out[4] * out[4])
    out[3] /= norm
    out[4] /= norm
    out[0] -= lateral_offset_m * out[4]
    out[1] += lateral_offset_m * out[3]
    out[2] += lateral_offset_m * bank_at(roads, lane, station_m)
