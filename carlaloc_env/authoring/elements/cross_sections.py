"""Cross-sections: templates of roads, and the lane sections they need near junctions."""

import itertools
from dataclasses import dataclass, field, replace

from carlaloc_env.authoring.geometry.elevation import Cubic, moved_cubic
from carlaloc_env.authoring.geometry.newton import PlanError

Records = tuple[tuple[float, Cubic], ...]
"""(ds, a b c d) of a quantity along a section; each holds up to the next."""
NONE: Records = ((0.0, (0.0, 0.0, 0.0, 0.0)),)
"""A quantity that is 0 all along."""
SIDEWALK_HEIGHT_M = 0.15
"""Height of sidewalks and medians above the road [m]."""
SOLID_BEFORE_JUNCTION_M = 25.0
"""Length before junctions on which lane marks are solid [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossSection:
    """Lanes of a road across, from its axis outwards.

    The axis lies in the middle of the median. `CrossSection(lanes=2, back=0)` is a one-way road: its axis is
    the left border of its left lane, with the inner shoulder, gutter and sidewalk on the other side.
    """

    lanes: int
    """Driving lanes along s."""
    back: int | None = None
    """Driving lanes against s; None: as many as along s; 0: one-way."""
    lane_m: float = 3.5
    median_m: float = 0.0
    inner_shoulder_m: float = 0.0
    """Paved strip between the left lane and the median, or left of a one-way road."""
    bike_m: float = 0.0
    """Cycle lane beside the outermost driving lane; 0 for none."""
    shoulder_m: float = 0.0
    """Hard shoulder; 0 for none."""
    gutter_m: float = 0.3
    sidewalk_m: float = 2.5
    left_sidewalk_m: float | None = None
    """Width of the sidewalk left of the axis where it differs, as a promenade does."""
    pocket_m: float = 3.0
    """Width of a left-turn pocket, taken from the median as far as it reaches."""
    marks: str = "full"
    """`full`, `edge` (edge lines only), `none` (no paint at all)."""
    gutter_surface: str = ""
    """What the gutter is made of where it is a soft shoulder; empty: as the lanes."""
    surface: str = "asphalt"
    """What the lanes are made of: `asphalt`, `concrete`, `gravel`, `dirt`; written as lane material."""

    @property
    def oneway(self) -> bool:
        """Whether no traffic runs against s."""
        return self.back == 0

    def count(self, side: str) -> int:
        """Driving lanes of side `R` (along s) or `L` (against s)."""
        return self.lanes if side == "R" or self.back is None else self.back

    def inner_m(self, side: str) -> float:
        """From the axis to the first driving lane of a side where the road is plain [m]."""
        if self.oneway:
            return 0.0 if side == "R" else self.inner_shoulder_m
        return 0.5 * self.median_m + self.inner_shoulder_m

    def beyond_m(self, side: str) -> float:
        """Width of everything beyond the driving lanes of a side, sidewalk included [m]."""
        walk = self.sidewalk_m if side == "R" or self.left_sidewalk_m is None else self.left_sidewalk_m
        if self.oneway and side == "L":
            return self.inner_shoulder_m + self.gutter_m + walk
        return self.bike_m + self.shoulder_m + self.gutter_m + walk

    @property
    def kerb_m(self) -> float:
        """From the axis to the kerb where the road is plain, on its wider side [m]."""
        outer = self.bike_m + self.shoulder_m + self.gutter_m
        sides = [self.inner_m("R") + self.lanes * self.lane_m + outer]
        if not self.oneway:
            sides.append(self.inner_m("L") + self.count("L") * self.lane_m + outer)
        return max(sides)


@dataclass(frozen=True, slots=True)
class Mark:
    """A road mark on the outer border of a lane; `s` runs from the start of its section."""

    s: float
    kind: str
    color: str = "white"
    width: float = 0.12
    change: str = "none"
    dash: tuple[float, float] | None = None
    """Length and gap of a broken line [m]."""


@dataclass(slots=True)
class LanePlan:
    """One lane of one section, named by `key` so that sections can be linked."""

    key: str
    kind: str
    width: Records
    marks: list[Mark] = field(default_factory=list)
    height_m: float = 0.0
    predecessor: int | None = None
    successor: int | None = None
    surface: str = "asphalt"

    def width_at(self, ds: float) -> float:
        """Width [m] at `ds` from the start of the section."""
        return value_at(self.width, ds)


@dataclass(slots=True)
class SectionPlan:
    """A lane section: lanes of each side from the centre outwards, and the shift of lane 0."""

    s: float
    length: float
    offset: Records
    left: list[LanePlan]
    right: list[LanePlan]
    centre: Mark

    def lanes(self) -> list[tuple[int, LanePlan]]:
        """(lane id, lane) of both sides, from left to right, without lane 0."""
        left = [(i + 1, lane) for i, lane in enumerate(self.left)]
        return left[::-1] + [(-i - 1, lane) for i, lane in enumerate(self.right)]

    def inner_border(self, lane_id: int, ds: float) -> float:
        """t of the border of a lane that faces lane 0 [m], at `ds` from the section's start."""
        sign = 1.0 if lane_id > 0 else -1.0
        side = self.left if lane_id > 0 else self.right
        inner = sum(lane.width_at(ds) for lane in side[: abs(lane_id) - 1])
        return value_at(self.offset, ds) + sign * inner


def value_at(records: Records, ds: float) -> float:
    """Value of a quantity at `ds`."""
    start, cubic = next(r for r in reversed(records) if r[0] <= ds or r is records[0])
    return moved_cubic(cubic, ds - start)[0]


def blend(first: float, last: float, length: float) -> Records:
    """From `first` to `last` with level ends, whose second derivative starts and ends at zero.

    One cubic would begin with a jump of the lane's curvature; three, the second derivative of which runs
    0, +p, −p, 0 in straight lines, do not.
    """
    rise = last - first
    if abs(rise) < 1e-12:
        return constant(first)
    quarter = 0.25 * length
    jerk = 0.5 * rise / quarter**3
    peak = jerk * quarter
    slope = 0.5 * peak * quarter
    return (
        (0.0, (first, 0.0, 0.0, jerk / 6)),
        (quarter, (first + jerk * quarter**3 / 6, slope, peak / 2, -jerk / 6)),
        (3 * quarter, (last - jerk * quarter**3 / 6, slope, -peak / 2, jerk / 6)),
    )


def constant(value: float) -> Records:
    """The same value all along."""
    return ((0.0, (value, 0.0, 0.0, 0.0)),)


def road_sections(
    cross: CrossSection, length: float, ends: tuple[str, str], taper_m: float, stores_m: tuple[float, float]
) -> list[SectionPlan]:
    """Lane sections of a two-way road.

    Args:
        cross: The template.
        length: Length of the road [m].
        ends: Layout at the start and at the end: `plain`, `pocket` (a left-turn lane for the
            traffic that leaves the road there) or `median` (spread as wide as a pocket).
        taper_m: Length of the transition between plain and another layout [m].
        stores_m: Length of the pocket or median at the start and at the end [m].
    """
    sections: list[SectionPlan] = []
    s0, s1 = 0.0, length
    if ends[0] != "plain":
        sections.append(_section(cross, 0.0, stores_m[0], ends[0], "start", (1.0, 1.0)))
        sections.append(_section(cross, stores_m[0], taper_m, ends[0], "start", (1.0, 0.0)))
        s0 = stores_m[0] + taper_m
    if ends[1] != "plain":
        s1 = length - stores_m[1] - taper_m
    if s1 < s0 + 1.0:
        raise PlanError(f"a road of {length:.1f} m has no room for its pockets (plain part {s1 - s0:.1f} m)")
    sections.append(_section(cross, s0, s1 - s0, "plain", "end", (0.0, 0.0)))
    if ends[1] != "plain":
        sections.append(_section(cross, s1, taper_m, ends[1], "end", (0.0, 1.0)))
        sections.append(_section(cross, s1 + taper_m, stores_m[1], ends[1], "end", (1.0, 1.0)))
    for before, after in itertools.pairwise(sections):
        link_sections(before, after)
    solid_before_junction(sections, length)
    return sections


def _section(
    cross: CrossSection, s: float, length: float, layout: str, end: str, share: tuple[float, float]
) -> SectionPlan:
    """One section in which the layout grows from `share[0]` to `share[1]` (0 plain, 1 whole)."""
    half, pocket = 0.5 * cross.median_m, cross.pocket_m

    def grow(plain: float, whole: float) -> Records:
        values = [plain + (whole - plain) * f for f in share]
        return blend(values[0], values[1], length)

    own, other, shift = _median_at(cross, layout)
    sides: dict[str, list[LanePlan]] = {}
    for side in ("L", "R"):
        lanes: list[LanePlan] = []
        turning = (side == "R") == (end == "end")
        median = grow(half, own if turning else other)
        if not cross.oneway and any(abs(v) > 1e-9 for _, record in median for v in record):
            lanes.append(LanePlan(f"{side}:median", "median", median, height_m=SIDEWALK_HEIGHT_M))
            if cross.median_m == 0.0:
                lanes[-1].height_m = 0.0
        if layout == "pocket" and turning:
            lanes.append(LanePlan(f"{side}:pocket", "driving", grow(0.0, pocket), surface=cross.surface))
        sides[side] = lanes + _side_lanes(cross, side)
    _mark_borders(cross, sides, layout)
    sign = 1.0 if end == "end" else -1.0
    offset = grow(0.0, sign * shift) if layout == "pocket" else NONE
    return SectionPlan(s, length, offset, sides["L"], sides["R"], _centre_mark(cross, sides))


def _median_at(cross: CrossSection, layout: str) -> tuple[float, float, float]:
    """Median on the side that turns and on the other [m] where a layout is whole, and the shift of lane 0."""
    half, pocket = 0.5 * cross.median_m, cross.pocket_m
    if layout != "pocket":
        wide = max(half, 0.5 * pocket)
        return wide, wide, 0.0
    if half >= pocket:
        return half - pocket, half, 0.0
    if cross.median_m > pocket:
        return 0.0, cross.median_m - pocket, pocket - half
    return 0.0, 0.0, 0.5 * pocket


def _side_lanes(cross: CrossSection, side: str) -> list[LanePlan]:
    lanes: list[LanePlan] = []

    def add(name: str, kind: str, width: float, height: float = 0.0) -> None:
        if width > 0:
            surface = "asphalt" if kind == "sidewalk" else cross.surface
            surface = (cross.gutter_surface or surface) if name == "gutter" else surface
            lanes.append(LanePlan(f"{side}:{name}", kind, constant(width), height_m=height, surface=surface))

    if side == "L" or not cross.oneway:
        add("inner", "shoulder", cross.inner_shoulder_m)
    for i in range(cross.count(side)):
        add(str(i), "driving", cross.lane_m)
    if cross.count(side):
        add("bike", "biking", cross.bike_m)
        add("shoulder", "shoulder", cross.shoulder_m)
    add("gutter", "shoulder", cross.gutter_m)
    back = cross.sidewalk_m if cross.left_sidewalk_m is None else cross.left_sidewalk_m
    add("walk", "sidewalk", cross.sidewalk_m if side == "R" else back, SIDEWALK_HEIGHT_M)
    return lanes


def _mark_borders(cross: CrossSection, sides: dict[str, list[LanePlan]], layout: str) -> None:
    raised = cross.median_m > 0
    for lanes in sides.values():
        for lane, outer in zip(lanes, [*lanes[1:], None], strict=True):
            lane.marks = [border_mark(lane, outer, raised, cross.marks)]
            if lane.key.endswith(":pocket") and layout == "pocket" and _is_whole(lane):
                lane.marks = [Mark(0.0, "solid")]


def border_mark(lane: LanePlan, outer: LanePlan | None, raised_median: bool, marks: str = "full") -> Mark:
    """Mark between a lane and its outer neighbour."""
    bare = Mark(0.0, "none", "standard", 0.0)
    if outer is None:
        return Mark(0.0, "solid") if lane.kind == "driving" and marks != "none" else bare
    if outer.kind == "sidewalk":
        return Mark(0.0, "curb", "standard", 0.15)
    if lane.kind == "median" and raised_median:
        return Mark(0.0, "curb", "standard", 0.15)
    if lane.kind == "driving" and outer.kind == "driving":
        broken = Mark(0.0, "broken", change="both", dash=(3.0, 6.0))
        return broken if marks == "full" else replace(bare, change="both")
    if marks == "none":
        return bare
    if lane.kind == "median" or (outer.kind == "driving" and lane.key.endswith(":inner")):
        return Mark(0.0, "solid", "yellow")
    return Mark(0.0, "solid") if lane.kind == "driving" else bare


def _centre_mark(cross: CrossSection, sides: dict[str, list[LanePlan]]) -> Mark:
    if cross.marks != "full" and not cross.oneway:
        return Mark(0.0, "none", "standard", 0.0)
    if cross.oneway:
        return Mark(0.0, "none" if cross.marks == "none" else "solid", "yellow")
    if all(lanes[0].kind == "median" for lanes in sides.values()):
        return Mark(0.0, "none", "standard", 0.0)
    if cross.lanes == 1 and cross.lane_m <= 3.3:
        return Mark(0.0, "broken", "yellow", change="none", dash=(3.0, 6.0))
    return Mark(0.0, "solid solid", "yellow", 0.12)


def solid_before_junction(sections: list[SectionPlan], length: float) -> None:
    """Draw lane lines solid where traffic nears a junction and must not change lanes any more.

    Beside a lane that opens or closes they stay broken, since cars enter or leave it there.
    """
    for section in sections:
        ahead = max(0.0, length - SOLID_BEFORE_JUNCTION_M - section.s)
        behind = min(section.length, SOLID_BEFORE_JUNCTION_M - section.s)
        for lane in _beside_whole(section.right):
            mark = lane.marks[0]
            if mark.kind == "broken" and ahead < section.length:
                lane.marks = [mark, Mark(ahead, "solid")] if ahead > 0 else [Mark(0.0, "solid")]
        for lane in _beside_whole(section.left):
            mark = lane.marks[0]
            if mark.kind == "broken" and behind > 0:
                rest = [replace(mark, s=behind)] if behind < section.length else []
                lane.marks = [Mark(0.0, "solid"), *rest]


def _beside_whole(side: list[LanePlan]) -> list[LanePlan]:
    """Lanes of which neither they nor the next ones outside of them open or close in the section."""
    return [lane for lane, outer in itertools.pairwise(side) if _is_whole(lane) and _is_whole(outer)]


def _is_whole(lane: LanePlan) -> bool:
    """Whether a lane is equally wide all along its section."""
    return all(not any(slopes) for _, (_, *slopes) in lane.width)


def link_sections(before: SectionPlan, after: SectionPlan) -> None:
    """Link lanes of the same key whose width at the joint is not zero."""
    following = {lane.key: (lane_id, lane) for lane_id, lane in after.lanes()}
    for lane_id, lane in before.lanes():
        match = following.get(lane.key)
        if match and lane.width_at(before.length) > 1e-6 and match[1].width_at(0.0) > 1e-6:
            lane.successor = match[0]
            match[1].predecessor = lane_id
