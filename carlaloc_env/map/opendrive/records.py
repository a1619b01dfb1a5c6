"""The contents of an OpenDRIVE file as frozen records (ASAM OpenDRIVE 1.4 to 1.7).

Lengths are metres, angles radians, speeds m/s. ``line`` is the line of the element in its file.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from carlaloc_env.core.geodesy import GeoReference

GeometryKind = Literal["line", "arc", "spiral", "poly3", "paramPoly3"]
"""Shapes of a piece of a reference line, OpenDRIVE's element names."""
GEOMETRY_KINDS: tuple[GeometryKind, ...] = get_args(GeometryKind)
"""All of them."""

Severity = Literal["error", "warning"]
"""error: data are wrong or left out, or cars cannot drive; warning: worth a look."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """One fault of a map, or something odd in it."""

    severity: Severity
    """How bad it is."""
    element: str
    """XML element, e.g. ``lane``."""
    id: str
    """Its id, with the road it belongs to."""
    line: int
    """Line in the file."""
    message: str

    def __str__(self) -> str:
        """One line: place, then message."""
        return f"{self.severity}: line {self.line}: <{self.element}> {self.id}: {self.message}"


@dataclass(frozen=True, slots=True)
class Cubic:
    """One record ``a + b·ds + c·ds² + d·ds³``, valid from `s_m` to the next record."""

    s_m: float
    a: float
    b: float
    c: float
    d: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """One piece of a road's reference line."""

    s_m: float
    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    kind: GeometryKind
    curvature_start_radpm: float = 0.0
    """Curvature at the start [1/m] of an arc or spiral."""
    curvature_end_radpm: float = 0.0
    """Curvature at the end [1/m]; equal to the start for an arc."""
    u_poly: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0)
    """Coefficients of u(p) [m] of poly3 (u = p) and paramPoly3."""
    v_poly: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Coefficients of v(p) [m] of poly3 and paramPoly3."""
    p_max: float = 1.0
    """Parameter at the end of the piece; poly3: an upper bound of it."""
    line: int = 0


@dataclass(frozen=True, slots=True)
class ShapeRecord:
    """Lateral road shape at `s_m`: height [m] as a cubic of t − `t_m`, valid from `t_m` on."""

    s_m: float
    t_m: float
    a: float
    b: float
    c: float
    d: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkLine:
    """One painted line of a road mark's ``<type>``."""

    length_m: float
    space_m: float
    t_offset_m: float
    s_offset_m: float
    width_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadMark:
    """Marking on the outer border of a lane (on the line itself for lane 0)."""

    s_offset_m: float
    type: str
    weight: str
    colour: str
    width_m: float | None
    lane_change: str = "both"
    """Changes that the mark allows: both, increase, decrease (of lane ids) or none."""
    lines: tuple[MarkLine, ...] = ()


@dataclass(frozen=True, slots=True)
class SpeedRecord:
    """Speed limit [m/s] from `s_m` on; infinite where the file says "no limit"."""

    s_m: float
    limit_mps: float


@dataclass(frozen=True, slots=True)
class LaneHeight:
    """Lane surface above the road surface at its inner and outer edge [m], from `s_m` on."""

    s_m: float
    inner_m: float
    outer_m: float


@dataclass(frozen=True, slots=True)
class LaneMaterial:
    """Material of a lane, from a station on."""

    s_m: float
    surface: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneRecord:
    """One lane of a lane section; positive ids lie left of the lane-offset line."""

    id: int
    type: str
    level: bool = False
    predecessors: tuple[int, ...] = ()
    successors: tuple[int, ...] = ()
    widths: tuple[Cubic, ...] = ()
    borders: tuple[Cubic, ...] = ()
    road_marks: tuple[RoadMark, ...] = ()
    speeds: tuple[SpeedRecord, ...] = ()
    heights: tuple[LaneHeight, ...] = ()
    materials: tuple[LaneMaterial, ...] = ()
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneSection:
    """Cross-section of a road from `s_m` to `end_m`; lanes from left to right, lane 0 included."""

    s_m: float
    end_m: float
    lanes: tuple[LaneRecord, ...]
    line: int = 0

    def lane(self, lane_id: int) -> LaneRecord | None:
        """The lane of that id, or None."""
        return next((lane for lane in self.lanes if lane.id == lane_id), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadLink:
    """The neighbour at a road's start or end."""

    element_type: Literal["road", "junction"]
    element_id: str
    contact: Literal["start", "end"] | None
    """Which end of the other road; None for junctions and where the file is silent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Validity:
    """Inclusive range of lane ids that a signal or object speaks to."""

    from_lane: int
    to_lane: int

    def holds(self, lane_id: int) -> bool:
        """True if the lane id lies in the range (whatever the order of its ends)."""
        low, high = sorted((self.from_lane, self.to_lane))
        return lane_id != 0 and low <= lane_id <= high


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalRecord:
    """A traffic light or sign on its pole."""

    id: str
    name: str
    s_m: float
    t_m: float
    z_offset_m: float
    h_offset_rad: float
    orientation: str
    dynamic: bool
    type: str
    value: float | None
    unit: str
    width_m: float
    height_m: float
    validity: tuple[Validity, ...]
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalReference:
    """Where a signal that stands elsewhere takes effect."""

    id: str
    s_m: float
    orientation: str
    validity: tuple[Validity, ...]
    line: int = 0


@dataclass(frozen=True, slots=True)
class CornerRoad:
    """Outline corner in road coordinates, `dz_m` above the road surface."""

    s_m: float
    t_m: float
    dz_m: float


@dataclass(frozen=True, slots=True)
class CornerLocal:
    """Outline corner in the object's own frame."""

    u_m: float
    v_m: float
    z_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """One outline of an object."""

    corners: tuple[CornerRoad | CornerLocal, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadObject:
    """Something beside or on the road: a crosswalk, stop line, pole or building."""

    id: str
    name: str
    type: str
    s_m: float
    t_m: float
    z_offset_m: float
    heading_rad: float
    length_m: float
    width_m: float
    height_m: float
    outlines: tuple[Outline, ...] = ()
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Passage:
    """A stretch of a road that the file calls a tunnel or bridge."""

    kind: Literal["tunnel", "bridge"]
    id: str
    s_m: float
    length_m: float
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Road:
    """One road: reference line, profiles, cross-sections and furniture."""

    id: str
    name: str
    length_m: float
    junction_id: str | None
    left_hand_traffic: bool
    predecessor: RoadLink | None
    successor: RoadLink | None
    type: str
    speeds: tuple[SpeedRecord, ...]
    geometry: tuple[Geometry, ...]
    elevation: tuple[Cubic, ...]
    superelevation: tuple[Cubic, ...]
    shape: tuple[ShapeRecord, ...]
    lane_offset: tuple[Cubic, ...]
    sections: tuple[LaneSection, ...]
    objects: tuple[RoadObject, ...] = ()
    signals: tuple[SignalRecord, ...] = ()
    signal_references: tuple[SignalReference, ...] = ()
    passages: tuple[Passage, ...] = ()
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A way into a junction: lanes of the incoming road onto lanes of the connecting road."""

    id: str
    incoming_road: str
    connecting_road: str
    """The linked road in a direct junction."""
    contact: Literal["start", "end"] | None
    lane_links: tuple[tuple[int, int], ...]
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class JunctionController:
    """A signal group that works in a junction; equal sequences are green together."""

    id: str
    sequence: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Junction:
    """A crossing: its connections and signal groups."""

    id: str
    name: str
    type: str
    connections: tuple[Connection, ...]
    controllers: tuple[JunctionController, ...] = ()
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller:
    """A signal group: signals that always show the same."""

    id: str
    name: str
    sequence: int
    signal_ids: tuple[str, ...]
    line: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenDrive:
    """A whole OpenDRIVE file."""

    source: str
    revision: tuple[int, int]
    name: str
    vendor: str
    geo: GeoReference | None
    """Where the world lies on the Earth; None where the file does not say."""
    shift_m: tuple[float, float]
    """World origin in the file's coordinates x, y [m]; not 0 where these are far from their own origin."""
    roads: tuple[Road, ...]
    junctions: tuple[Junction, ...]
    controllers: tuple[Controller, ...]
    notes: tuple[Note, ...] = ()
