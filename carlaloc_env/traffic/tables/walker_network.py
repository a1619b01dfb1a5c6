"""Walker network as record arrays that compiled functions read."""

from typing import Annotated, NamedTuple

from carlaloc_env.core.array_types import Array, Index

SIDEWALK, CROSSWALK = 0, 1
"""Kinds of walker paths."""


class WalkerPaths:
    """Paths of walkers, sidewalks and crosswalks, F rows."""

    kind: Index
    """SIDEWALK or CROSSWALK."""
    length_m: Array
    """Length [m]."""
    own_side: Array
    """Side on which walkers keep: −1 right, 1 left where traffic keeps to the left."""
    demand: Array
    """How much more often walkers choose it than one in a side street."""
    row_first: Index
    row_count: Index
    row_step_m: Array
    """Spacing of the samples [m]."""
    kerb_m: Annotated[Array, 2]
    """Crosswalks: stations between which it lies on the carriageway [m]."""
    entry_first: Index
    entry_end: Index
    """Sidewalks: rows of `CrosswalkEntries`, in the order of their stations."""
    join_first: Annotated[Index, 2]
    """Where the joins at start and end begin."""
    join_end: Annotated[Index, 2]
    lane_crossing_first: Index
    lane_crossing_end: Index
    """Crosswalks: rows of `LaneCrossings`."""


class WalkerPathSamples:
    """Samples along walker paths, R rows."""

    position_m: Annotated[Array, 3]
    """World [m]."""
    tangent: Annotated[Array, 2]
    """Cosine and sine of the direction."""
    width_m: Array
    """Width [m]."""


class CrosswalkEntries:
    """Points at which crosswalks leave sidewalks."""

    station_m: Array
    """Station on the sidewalk [m]."""
    crosswalk: Index
    """Path over the road."""
    end: Index
    """Which end of it lies here: 0 start, 1 end."""


class LaneCrossings:
    """Lanes that a crosswalk crosses."""

    crossing: Index
    """Row of `Roads.crossing`."""
    near_m: Array
    """Station of the path at which the lane begins [m]."""
    far_m: Array
    """Station at which it ends [m]."""
    head_first: Index
    head_end: Index
    """Lights that stop traffic on the lane, so that walkers may cross: rows of `WalkerNetwork.head`."""


class WalkerNetwork(NamedTuple):
    """Walker network of a town: paths, their samples, and how they join."""

    path: WalkerPaths
    """Paths, (F,)."""
    row: WalkerPathSamples
    """Samples of all paths, (R,)."""
    entry: CrosswalkEntries
    """Entries of crosswalks."""
    lane_crossing: LaneCrossings
    """Crossings of crosswalks and lanes."""
    join_path: Index
    """Paths that join others, end to end."""
    join_end: Index
    """Which end of each of them joins."""
    landing: Annotated[Index, 2]
    """Sidewalk at start and end of each crosswalk, −1 for sidewalks, (F, 2)."""
    landing_m: Array
    """Station there [m], (F, 2)."""
    head: Index
    """Numbers of signal heads, end to end."""
