"""Moves maps whose coordinates are large, such as absolute UTM metres, near the world's origin."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from carlaloc_env.map.opendrive.records import Note, Road
from carlaloc_env.map.opendrive.xml_document import Document

FAR_M = 20_000.0
"""Maps nearer to their origin stay where they are: single precision holds 2 mm there [m]."""
REACH_M = 100_000.0
"""Roads farther than this from the middle of the others are left out [m]."""
STEP_M = 1000.0
"""Shifts are multiples of this [m], so that coordinates of both can be compared by eye."""


def near_origin(document: Document, roads: Sequence[Road]) -> tuple[list[Road], tuple[float, float]]:
    """Roads near the world's origin, and where that lies in the file's coordinates x, y [m].

    Roads that lie farther than `REACH_M` from the rest are left out with a note.
    """
    if not roads:
        return [], (0.0, 0.0)
    middle = np.median([(road.geometry[0].x_m, road.geometry[0].y_m) for road in roads], axis=0)
    shift = np.round(middle / STEP_M) * STEP_M if np.abs(middle).max() > FAR_M else np.zeros(2)
    x, y = (float(part) for part in shift)
    if x or y:
        message = f"coordinates are far from their origin; the world's origin is x={x:.0f}, y={y:.0f} of them"
        document.note(document.root, message)
        roads = [_shifted(road, x, y) for road in roads]
    near = [road for road in roads if _reach_m(road) <= REACH_M]
    for road in roads:
        if _reach_m(road) > REACH_M:
            message = f"lies {_reach_m(road):.3g} m from the rest, so it is left out; correct its geometry"
            document.notes.append(
                Note(severity="error", element="road", id=road.id, line=road.line, message=message)
            )
    return near, (x, y)


def _shifted(road: Road, x_m: float, y_m: float) -> Road:
    return replace(road, geometry=tuple(replace(g, x_m=g.x_m - x_m, y_m=g.y_m - y_m) for g in road.geometry))


def _reach_m(road: Road) -> float:
    return max(max(abs(g.x_m), abs(g.y_m)) for g in road.geometry)
