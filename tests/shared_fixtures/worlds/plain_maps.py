"""OpenDRIVE files read from their XML by formulas of their own."""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import cumulative_simpson

Element = ElementTree.Element


def poly(element: Element, ds: float, names: str = "abcd") -> tuple[float, float, float]:
    """Value, first and second derivative of a cubic record."""
    a, b, c, d = (float(element.get(name, "0")) for name in names)
    return a + ds * (b + ds * (c + ds * d)), b + ds * (2 * c + 3 * ds * d), 2 * c + 6 * ds * d


def active(records: list[Element], s: float, key: str = "s") -> tuple[Element, float] | None:
    """Record that holds at s, and the distance into it."""
    found = None
    for record in records:
        if float(record.get(key, "0")) <= s + 1e-9:
            found = (record, s - float(record.get(key, "0")))
    return found


@dataclass
class LaneEnd:
    """State of a lane's centre in its travel direction."""

    position: np.ndarray
    heading: float
    width: float
    slope: float
    curvature: float


@dataclass
class PlainRoad:
    """One road of the file."""

    xml: Element
    length: float = 0.0
    junction: str = "-1"
    sections: list[Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.length = float(self.xml.get("length", "nan"))
        self.junction = self.xml.get("junction", "")
        self.sections = self.xml.findall("lanes/laneSection")

    def section_span(self, k: int) -> tuple[float, float]:
        starts = [float(s.get("s", "nan")) for s in self.sections] + [self.length]
        return starts[k], starts[k + 1]

    def line(self, s: float) -> tuple[float, float, float, float]:
        """x, y, heading, curvature of the reference line, by integrating the curvature numerically."""
        geometry, ds = active(self.xml.findall("planView/geometry"), s) or (self.xml, 0.0)
        x, y, h = (float(geometry.get(k, "nan")) for k in ("x", "y", "hdg"))
        length, shape = float(geometry.get("length", "nan")), geometry[0]
        if shape.tag == "paramPoly3":
            p = ds / length
            u, du, ddu = poly(shape, p, ["aU", "bU", "cU", "dU"])  # type: ignore[arg-type]
            v, dv, ddv = poly(shape, p, ["aV", "bV", "cV", "dV"])  # type: ignore[arg-type]
            kappa = (du * ddv - dv * ddu) / math.hypot(du, dv) ** 3
            turn = math.atan2(dv, du)
        else:
            k0 = float(shape.get("curvature", shape.get("curvStart", "0")))
            k1 = float(shape.get("curvature", shape.get("curvEnd", "0")))
            grid = np.linspace(0.0, ds, 801)
            theta = k0 * grid + 0.5 * (k1 - k0) / length * grid**2
            if ds > 0:
                u = float(cumulative_simpson(np.cos(theta), x=grid)[-1])
                v = float(cumulative_simpson(np.sin(theta), x=grid)[-1])
            else:
                u = v = 0.0
            turn, kappa = float(theta[-1]), k0 + (k1 - k0) * ds / length
        c, w = math.cos(h), math.sin(h)
        return x + c * u - w * v, y + w * u + c * v, h + turn, kappa

    def lane(self, k: int, lane_id: int, s: float) -> LaneEnd:
        """Centre of a lane, seen in its travel direction."""
        start, _ = self.section_span(k)
        offset = active(self.xml.findall("lanes/laneOffset"), s)
        t = np.array(poly(*offset) if offset else (0.0, 0.0, 0.0))
        sign = 1.0 if lane_id > 0 else -1.0
        width = np.zeros(3)
        for lane in range(1, abs(lane_id) + 1):
            element = self.sections[k].find(f".//lane[@id='{int(sign) * lane}']")
            assert element is not None
            record = active(element.findall("width"), s - start, "sOffset")
            assert record is not None
            width = np.array(poly(*record))
            t = t + sign * width * (1.0 if lane < abs(lane_id) else 0.5)
        x, y, h, kappa = self.line(s)
        elevation = active(self.xml.findall("elevationProfile/elevation"), s)
        assert elevation is not None
        z, slope, _ = poly(*elevation)
        heading = h + math.atan2(t[1], 1 - kappa * t[0])
        bent = kappa / (1 - kappa * t[0]) + t[2]
        forward = -sign
        turned = 0.0 if forward > 0 else math.pi
        position = np.array([x - math.sin(h) * t[0], y + math.cos(h) * t[0], z])
        return LaneEnd(position, heading + turned, width[0], slope * forward, bent * forward)


@dataclass
class PlainMap:
    """The parts of a file that the checks look at."""

    root: Element
    roads: dict[str, PlainRoad]

    def driving(self) -> list[tuple[str, int, int]]:
        return [
            (road_id, k, int(lane.get("id", "0")))
            for road_id, road in self.roads.items()
            for k, section in enumerate(road.sections)
            for lane in section.iter("lane")
            if lane.get("type") == "driving"
        ]

    def lane_end(self, key: tuple[str, int, int], *, last: bool) -> LaneEnd:
        """Where traffic leaves (last) or enters the lane."""
        road = self.roads[key[0]]
        span = road.section_span(key[1])
        return road.lane(key[1], key[2], span[1] if last == (key[2] < 0) else span[0])

    def successors(self) -> dict[tuple[str, int, int], list[tuple[str, int, int]]]:
        """Driving lanes that follow each driving lane, from the XML's links."""
        following: dict[tuple[str, int, int], list[tuple[str, int, int]]] = {k: [] for k in self.driving()}
        for road_id, k, lane_id in list(following):
            road = self.roads[road_id]
            tag, step = ("successor", 1) if lane_id < 0 else ("predecessor", -1)
            lane = road.sections[k].find(f".//lane[@id='{lane_id}']")
            link = lane.find(f"link/{tag}") if lane is not None else None
            beyond = k + step
            if 0 <= beyond < len(road.sections):
                if link is not None:
                    following[road_id, k, lane_id].append((road_id, beyond, int(link.get("id", "0"))))
                continue
            end = road.xml.find(f"link/{tag}")
            assert end is not None, f"road {road_id} has no {tag}"
            if end.get("elementType") == "road":
                assert link is not None
                other = self.roads[end.get("elementId", "")]
                at = len(other.sections) - 1 if end.get("contactPoint") == "end" else 0
                following[road_id, k, lane_id].append(
                    (end.get("elementId", ""), at, int(link.get("id", "0")))
                )
                continue
            junction = self.root.find(f"junction[@id='{end.get('elementId')}']")
            assert junction is not None
            for connection in junction.findall(f"connection[@incomingRoad='{road_id}']"):
                for pair in connection.findall("laneLink"):
                    if int(pair.get("from", "0")) == lane_id:
                        target = (connection.get("connectingRoad", ""), 0, int(pair.get("to", "0")))
                        following[road_id, k, lane_id].append(target)
        return following
