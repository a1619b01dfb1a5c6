"""Lanes that exist on a part of a road only: auxiliary lanes, third lanes, parking bays."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

from carlaloc_env.authoring.elements.cross_sections import (
    CrossSection,
    LanePlan,
    Records,
    SectionPlan,
    blend,
    border_mark,
    constant,
    link_sections,
    solid_before_junction,
)
from carlaloc_env.authoring.geometry.elevation import moved_cubic
from carlaloc_env.authoring.geometry.newton import PlanError


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtraLane:
    """A lane more on one side of a road, from one station to another.

    `ExtraLane(side="R", first_m=-120.0)` adds a lane on the right of the traffic along s that begins 120 m
    before the road's end and leads into the junction there.
    """

    side: str
    """`R` for traffic along s, `L` for traffic against it."""
    first_m: float | None = None
    """Where its taper begins [m]; negative from the road's end; None: it exists from the start on."""
    last_m: float | None = None
    """Where its other taper ends [m]; negative from the road's end; None: it exists up to the end."""
    taper_m: float = 40.0
    """Length of both tapers [m]."""
    width_m: float = 3.5
    """Its whole width [m]."""
    outer: bool = True
    """Beside the shoulder or kerb; False: beside the median or centre line."""
    kind: str = "driving"
    """Lane type of OpenDRIVE."""
    name: str = "extra"
    """Distinguishes several extra lanes of one side."""


@dataclass(frozen=True, slots=True)
class _Span:
    lane: ExtraLane
    begin: float
    end: float
    opens: bool
    closes: bool

    def cuts(self) -> list[float]:
        """Stations at which the road needs a new section."""
        taper = self.lane.taper_m
        opening = [self.begin, self.begin + taper] if self.opens else []
        return opening + ([self.end - taper, self.end] if self.closes else [])

    def width(self, s: float, length: float) -> Records | None:
        """Width records of a section; None where the lane does not exist."""
        middle, taper, width = s + 0.5 * length, self.lane.taper_m, self.lane.width_m
        if not self.begin < middle < self.end:
            return None
        if self.opens and middle < self.begin + taper:
            return part_of(blend(0.0, width, taper), s - self.begin, s + length - self.begin)
        if self.closes and middle > self.end - taper:
            first = self.end - taper
            return part_of(blend(width, 0.0, taper), s - first, s + length - first)
        return constant(width)


def add_extra_lanes(
    sections: Sequence[SectionPlan], cross: CrossSection, length: float, extra: Sequence[ExtraLane]
) -> list[SectionPlan]:
    """Sections of a road with its extra lanes.

    Raises:
        PlanError: A lane does not fit on the road.
    """
    if not extra:
        return list(sections)
    spans = [_span(lane, length) for lane in extra]
    stations = sorted({round(s, 9) for span in spans for s in span.cuts()})
    result = list(sections)
    for station in stations:
        result = _split_at(result, station)
    for section in result:
        for lane in [*section.left, *section.right]:
            lane.predecessor = lane.successor = None
        for span in spans:
            width = span.width(section.s, section.length)
            if width is not None:
                _insert(section, span.lane, width)
        for side in (section.left, section.right):
            _mark(side, cross)
    for before, after in itertools.pairwise(result):
        link_sections(before, after)
    solid_before_junction(result, length)
    return result


def _span(lane: ExtraLane, length: float) -> _Span:
    def station(value: float) -> float:
        return value + length if value < 0 else value

    begin = 0.0 if lane.first_m is None else station(lane.first_m)
    end = length if lane.last_m is None else station(lane.last_m)
    span = _Span(lane, begin, end, lane.first_m is not None, lane.last_m is not None)
    need = lane.taper_m * (span.opens + span.closes)
    if begin < -1e-9 or end > length + 1e-9 or end - begin < need - 1e-9:
        raise PlanError(
            f"an extra lane from {begin:.1f} to {end:.1f} m with tapers of {lane.taper_m:.1f} m "
            f"does not fit on a road of {length:.1f} m"
        )
    return span


def _split_at(sections: Sequence[SectionPlan], station: float) -> list[SectionPlan]:
    result = []
    for section in sections:
        ds = station - section.s
        if 1e-6 < ds < section.length - 1e-6:
            result += [_part(section, 0.0, ds), _part(section, ds, section.length)]
        else:
            result.append(section)
    return result


def _part(section: SectionPlan, a: float, b: float) -> SectionPlan:
    def lanes(side: Sequence[LanePlan]) -> list[LanePlan]:
        return [
            LanePlan(p.key, p.kind, part_of(p.width, a, b), _marks(p, a, b), p.height_m, surface=p.surface)
            for p in side
        ]

    offset = part_of(section.offset, a, b)
    left, right = lanes(section.left), lanes(section.right)
    return SectionPlan(section.s + a, b - a, offset, left, right, section.centre)


def _marks(lane: LanePlan, a: float, b: float) -> list:  # type: ignore[type-arg]
    held = [m for m in lane.marks if m.s <= a + 1e-9][-1:]
    later = [m for m in lane.marks if a + 1e-9 < m.s < b - 1e-9]
    return [replace(m, s=max(m.s - a, 0.0)) for m in [*held, *later]]


def part_of(records: Records, first: float, last: float) -> Records:
    """The same quantity from `first` to `last`, counted from there."""
    result = []
    for k, (start, cubic) in enumerate(records):
        end = records[k + 1][0] if k + 1 < len(records) else float("inf")
        if end <= first + 1e-6 or start >= last - 1e-6:
            continue
        # A length of a nanometre comes from rounding.
        ahead = start - first if start - first > 1e-6 else 0.0
        result.append((ahead, moved_cubic(cubic, max(first - start, 0.0))))
    return tuple(result)


def _insert(section: SectionPlan, extra: ExtraLane, width: Records) -> None:
    side = section.right if extra.side == "R" else section.left
    driving = [k for k, lane in enumerate(side) if lane.kind == "driving"]
    if not driving:
        raise PlanError(f"an extra lane stands on side {extra.side}, where the road has no driving lane")
    at = driving[-1] + 1 if extra.outer else driving[0]
    surface = side[driving[0]].surface
    side.insert(at, LanePlan(f"{extra.side}:{extra.name}", extra.kind, width, surface=surface))


def _mark(side: Sequence[LanePlan], cross: CrossSection) -> None:
    """Marks of the borders that extra lanes changed."""
    for lane, outer in zip(side, [*side[1:], None], strict=True):
        if not lane.key.endswith(":pocket"):
            lane.marks = [border_mark(lane, outer, cross.median_m > 0, cross.marks)]
