"""Pavements and crosswalks as tables that compiled functions read."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from carlaloc_env.core.array_types import Array, Index

PAVEMENT, CROSSWALK = 0, 1
"""Kinds of footways."""


class Footways:
    """Footways, F rows."""

    kind: Index
    """PAVEMENT or CROSSWALK."""
    length_m: Array
    """Length [m]."""
    row_first: Index
    row_count: Index
    row_step_m: Array
    """Spacing of the samples [m]."""
    kerb_m: Annotated[Array, 2]
    """Crosswalks: stations between which it lies on the carriageway [m]."""
    door_first: Index
    door_end: Index
    """Pavements: rows of `Doors`, in the order of their stations."""
    join_first: Annotated[Index, 2]
    """Where the joins at start and end begin."""
    join_end: Annotated[Index, 2]
    pass_first: Index
    pass_end: Index
    """Crosswalks: rows of `Passes`."""


class FootRows:
    """Samples along footways."""

    position_m: Annotated[Array, 3]
    """World [m]."""
    tangent: Annotated[Array, 2]
    """Cosine and sine of the direction."""
    width_m: Array
    """Width [m]."""


class Doors:
    """Where crosswalks leave pavements."""

    station_m: Array
    """Station on the pavement [m]."""
    crosswalk: Index
    """Footway over the road."""
    end: Index
    """Which end of it lies here: 0 start, 1 end."""


class Passes:
    """Lanes that a crosswalk crosses."""

    crossing: Index
    """Row of `Roads.crossing`."""
    near_m: Array
    """Station of the footway at which the lane begins [m]."""
    far_m: Array
    """Station at which it ends [m]."""
    head_first: Index
    head_end: Index
    """Lights before which traffic on the lane stops, so that one may walk: rows of `Ground.head`."""


class Ground(NamedTuple):
    """Everything that walkers need to know of a town."""

    way: Footways
    row: FootRows
    door: Doors
    passage: Passes
    join_way: Index
    """Footways that join others."""
    join_end: Index
    """Which end of each of them joins."""
    land: Annotated[Index, 2]
    """Pavement at start and end of each crosswalk, −1 for pavements, (F, 2)."""
    land_m: Array
    """Station there [m], (F, 2)."""
    head: Index
    """Signal heads."""
