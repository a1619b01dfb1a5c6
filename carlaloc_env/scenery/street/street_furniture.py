"""Things on sidewalks: lamps, trees, benches, bins, hydrants, shelters, and hedges behind them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.terrain import Zones
from carlaloc_env.scenery.meshing.props import InstanceIds, copies, poses
from carlaloc_env.scenery.roads.sidewalks import raised_runs, run_edges
from carlaloc_env.scenery.street.sidewalk_props import LAMP_ARM_M, LAMP_HEIGHT_M, Placement, prop_mesh
from carlaloc_env.scenery.structures.lamp_masts import lamp_reach
from carlaloc_env.scenery.vegetation.planting import DETAIL_M

LAMP_STEP_M = 30.0
"""Distance of lamps on one side of a street [m]."""
TREE_STEP_M = 9.0
"""Distance of street trees [m]."""
FIRST_TREE_M = 4
"""From the first lamp to the first tree [m]."""
LAMP_CLEAR_M = 2
"""No tree stands so near behind a lamp [m]."""
SMALL_STEP_M, FIRST_SMALL_M = 13, 7
"""Distance of benches, bins and the like, and from the first lamp to the first of them [m]."""
KERB_DISTANCE_M = 0.75
"""Distance of lamps and trees from the kerb [m]."""
END_M = 9.0
"""Length beside junctions that stays free of trees and furniture [m]."""
NARROW_M = 2.2
"""Sidewalks narrower than this carry no trees [m]."""
NAME_POST_M = 3
"""Distance of posts with the street's name from its end [m]."""
NAMED_ZONES = ("downtown", "skyscraper", "small_town", "residential", "industrial", "waterfront")
"""Zones in which streets have such posts."""
PROTOTYPES = 5
"""Different trees of each kind."""
TREE_KINDS: dict[str, tuple[str, ...]] = {
    "downtown": ("plane", "lime"),
    "skyscraper": ("lime", "plane"),
    "residential": ("lime", "autumn", "birch"),
    "small_town": ("plane", "autumn", "lime"),
    "industrial": ("birch",),
    "rural": ("plane", "birch"),
    "highway": ("plane", "birch"),
    "waterfront": ("lime", "plane"),
    "park": ("plane", "autumn", "birch"),
    "water": (),
}
"""Street trees of each kind of zone; their crowns begin above the roofs of cars."""


class Furnisher:
    """Places furniture along sidewalks, clear of crossings, posts and the mouths of junctions."""

    def __init__(
        self,
        zones: Zones,
        keep_clear_m: Array,
        route_m: Array | None,
        footprints: Sequence[Area],
        roofed: Area,
        seed: int,
    ) -> None:
        """Prepare.

        Args:
            zones: Kinds of scenery with their areas.
            keep_clear_m: Points that stay free for 2.5 m [m], shape (K, 2).
            route_m: The ego's route, along which trees are detailed [m], shape (N, 2); None: in all streets.
            footprints: Buildings, before whose walls no hedge grows.
            roofed: Where something passes overhead; nothing stands there.
            seed: Seed of the town.
        """
        self._zones = zones
        self._footprints = shapely.STRtree(list(footprints))
        self._roofed = shapely.buffer(roofed, 4.0)
        shapely.prepare(self._roofed)
        self._clear = cKDTree(keep_clear_m) if len(keep_clear_m) else None
        self._route = cKDTree(route_m) if route_m is not None and len(route_m) else None
        self._seed = seed
        self.placed = Placement()

    def sidewalk(self, strip: Strip) -> None:
        """Furnish the sidewalks of one strip."""
        for first, last in raised_runs(strip):
            if strip.kind(first) != "sidewalk":
                continue
            left, right = run_edges(strip, first, last)
            if first > 0 and strip.kind(first - 1) == "roadway":
                self._side(strip, f"{first}/left", left[::-1], right[::-1])
            elif last < len(strip.lanes) - 1 and strip.kind(last + 1) == "roadway":
                self._side(strip, f"{first}/right", right, left)

    def meshes(self, ids: InstanceIds) -> list[Mesh]:
        """All props as meshes, with an instance id each."""
        meshes = []
        for key in sorted(self.placed.bases_m):
            name, variant, detail = key
            bases_m = np.array(self.placed.bases_m[key])
            yaws = np.array(self.placed.yaws[key])
            draw = clock.stream(self._seed, f"props/{name}/{variant}/{detail}")
            scale, tint = np.ones(len(bases_m)), None
            if name.startswith("tree "):
                scale = draw.uniform(0.85, 1.15, len(bases_m))
                tint = draw.uniform(0.75, 1.1, (len(bases_m), 1)) * draw.uniform(
                    0.93, 1.07, (len(bases_m), 3)
                )
            mesh = prop_mesh(name, variant, detail)
            meshes.append(copies(mesh, poses(bases_m, yaws, scale), ids.take(len(bases_m)), tint))
        return meshes

    def lamps_m(self) -> Array:
        """Light sources of the lamps [m], shape (K, 3)."""
        key = ("lamp", 0, "")
        bases_m = self.placed.bases_of("lamp")
        if not len(bases_m):
            return bases_m
        yaw = np.array(self.placed.yaws[key])
        result: Array = bases_m + lamp_reach(yaw, LAMP_ARM_M, LAMP_HEIGHT_M)
        return result

    def _side(self, strip: Strip, name: str, kerb: Array, outer: Array) -> None:
        """One sidewalk; both lines run with the road on their right-hand side."""
        line, far = _equal_steps(kerb, outer)
        length = len(line) - 1
        if length < 2 * END_M:
            return
        draw = clock.stream(self._seed, f"furniture/{strip.road_id}/{strip.section}/{name}")
        zone = self._zones.kind_at(line[length // 2], self._zones.default)
        width = float(np.median(np.hypot(*(line - far)[:, :2].T)))
        shift = int(draw.integers(0, int(LAMP_STEP_M)))
        for at in range(int(END_M), length - int(END_M) + 1):
            row = _Row(line, far, at)
            metre = at + shift
            past_lamp_m = metre % int(LAMP_STEP_M)
            if past_lamp_m == 0:
                self._lamp(row, zone, draw)
            elif metre % int(TREE_STEP_M) == FIRST_TREE_M and width >= NARROW_M and zone != "industrial":
                if self._free(row.at(KERB_DISTANCE_M + 0.2)) and past_lamp_m > LAMP_CLEAR_M:
                    self._tree(row.at(KERB_DISTANCE_M + 0.2, -0.03), zone, draw)
            elif metre % SMALL_STEP_M == FIRST_SMALL_M:
                self._small(row, zone, draw, width)
        corner = _Row(line, far, length - NAME_POST_M)
        if name.endswith("right") and zone in NAMED_ZONES and self._free(corner.at(0.5), 1.2):
            self.placed.put("street_name", corner.at(0.5), corner.yaw, sum(strip.road_id.encode()) % 8)
        if zone in ("residential", "small_town", "rural"):
            self._hedges(line, far, draw)
        if zone in ("downtown", "skyscraper", "small_town") and length > 70 and draw.random() < 0.6:
            row = _Row(line, far, int(END_M) + 14)
            if self._free(row.at(width - 1.0), 4.5) and width >= 2.4:
                self.placed.put("bus_shelter", row.at(width - 0.85), row.yaw, int(draw.integers(0, 16)))

    def _lamp(self, row: _Row, zone: str, draw: np.random.Generator) -> None:
        base_m = row.at(KERB_DISTANCE_M - 0.15)
        if not self._free(base_m, 1.5):
            return
        self.placed.put("lamp", base_m, row.yaw)
        if zone in ("downtown", "skyscraper") and draw.random() < 0.6:
            self.placed.put("banner", base_m, row.yaw + np.pi / 2, int(draw.integers(0, 16)))

    def _tree(self, base_m: Array, zone: str, draw: np.random.Generator) -> None:
        kinds = TREE_KINDS[zone]
        if not kinds or draw.random() < 0.12:
            return
        kind = kinds[int(draw.integers(len(kinds)))]
        near = self._route is None or self._route.query(base_m[:2])[0] < DETAIL_M
        yaw, variant = float(draw.uniform(0, 2 * np.pi)), int(draw.integers(PROTOTYPES))
        self.placed.put(f"tree {kind}", base_m, yaw, variant, "high" if near else "low")

    def _small(self, row: _Row, zone: str, draw: np.random.Generator, width: float) -> None:
        if zone in ("rural", "industrial"):
            return
        names = ("bench", "bin", "hydrant", "newspaper_box", "post_box", "cabinet", "planter", "column")
        weights = np.array([3.0, 3.5, 1.5, 1.5, 0.7, 1.2, 2.0, 0.5])
        if zone == "residential":
            weights = np.array([0.5, 1.5, 1.5, 0.0, 0.7, 1.2, 0.0, 0.0])
        name = names[int(draw.choice(len(names), p=weights / weights.sum()))]
        beside_wall = name in ("cabinet", "bench") and width > 2.2
        distance = width - 0.45 if beside_wall else 0.65
        if name == "column":
            distance = 1.1
        base_m = row.at(distance)
        if self._free(base_m):
            variant = int(draw.integers(0, 16)) if name == "column" else 0
            self.placed.put(name, base_m, row.yaw, variant)

    def _hedges(self, line: Array, far: Array, draw: np.random.Generator) -> None:
        """Hedges along the outer edge, with gaps for gates."""
        gate = 0
        for at in range(int(END_M), len(line) - 1 - int(END_M), 3):
            gate -= 1
            if draw.random() < 0.22:
                gate = 2
            if gate >= 0 or draw.random() < 0.1:
                continue
            row = _Row(line, far, at)
            width = float(np.hypot(*(far[at] - line[at])[:2]))
            base_m = row.at(width + 0.55, -0.1)
            yaw = row.yaw + np.pi / 2
            end = base_m[:2] + 3.0 * np.array([elementary.cos(yaw), elementary.sin(yaw)])
            line_of_hedge = shapely.LineString([base_m[:2], end])
            if len(self._footprints.query(line_of_hedge, predicate="dwithin", distance=1.2)):
                continue
            if self._zones.kind_at(base_m, self._zones.default) in ("residential", "small_town", "rural"):
                self.placed.put("hedge", base_m, yaw, int(draw.integers(0, 3)))

    def _free(self, base_m: Array, radius_m: float = 2.5) -> bool:
        if shapely.intersects_xy(self._roofed, base_m[0], base_m[1]):
            return False
        return self._clear is None or bool(self._clear.query(base_m[:2])[0] > radius_m)


class _Row:
    """A place on a sidewalk: distances count from the kerb away from the road."""

    def __init__(self, line: Array, far: Array, at: int) -> None:
        tangent = line[min(at + 1, len(line) - 1)] - line[max(at - 1, 0)]
        tangent[2] = 0.0
        tangent /= np.hypot(tangent[0], tangent[1])
        self._kerb = line[at]
        self._slope = (far[at][2] - line[at][2]) / max(np.hypot(*(far[at] - line[at])[:2]), 0.1)
        self._away = np.array([-tangent[1], tangent[0], 0.0])
        self.yaw = float(elementary.arctan2(-self._away[1], -self._away[0]))
        """Direction towards the road [rad]."""

    def at(self, distance_m: float, rise_m: float = 0.0) -> Array:
        """Point [m] that far from the kerb."""
        point: Array = self._kerb + self._away * distance_m + [0.0, 0.0, self._slope * distance_m + rise_m]
        return point


def _equal_steps(kerb: Array, outer: Array) -> tuple[Array, Array]:
    """Both lines with a point per metre of the kerb."""
    length = distance_along(kerb)
    at = np.arange(0.0, np.floor(length[-1]) + 1.0)
    return interpolated(at, length, kerb), interpolated(at, length, outer)
