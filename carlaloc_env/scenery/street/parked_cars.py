"""Cars that stand still: in parking lanes, on verges, in drives beside houses and in car parks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from carlaloc_env.assets.catalog import VEHICLES
from carlaloc_env.assets.model_library import vehicle
from carlaloc_env.assets.number_plates import PLATES, plate_of, plate_uv
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.road_edges import RoadEdge, Waysides
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads, turned
from carlaloc_env.scenery.meshing.props import InstanceIds, copies, poses

CARS = (*(name for name, model in VEHICLES.items() if model.tag == Tag.CAR), "pickup", "van")
"""Models that are parked."""
SPACE_M = 6.4
"""Length of a place along a kerb [m]."""
PARKING_WIDTH_M, SHOULDER_WIDTH_M = 1.95, 2.2
"""Narrowest parking lanes and shoulders on which cars stand [m]."""
JUNCTION_M, CROSSWALK_M = 10.0, 6.0
"""Distance of parked cars from the ends of roads and from crosswalks [m]."""
DRIVE_STEP_M, DRIVE_M = 15.0, (2.9, 8.2)
"""Distance of drives along a street, and their width and length [m]."""
VERGE_M = 0.35
"""Distance of cars on a verge from the road [m]."""
OCCUPIED = {"downtown": 0.75, "skyscraper": 0.7, "small_town": 0.6, "residential": 0.5, "waterfront": 0.6,
            "industrial": 0.5}  # fmt: skip
"""Share of the places along a kerb that are taken, in zones with any."""
VERGES = {"residential": 0.3, "small_town": 0.2}
"""Share of the places on grass verges that are taken."""
DRIVES = {"residential": 0.75, "small_town": 0.35}
"""Share of the possible drives that are laid."""
SLOWEST_MPS = 70.0 / 3.6
"""No car parks beside roads with a higher limit [m/s]."""


@dataclass(slots=True, eq=False)
class ParkedCars:
    """Cars chosen so far."""

    names: list[str] = field(default_factory=list)
    """Models."""
    bases_m: list[Array] = field(default_factory=list)
    """Middles of their footprints on the ground [m], (3,) each."""
    yaws_rad: list[float] = field(default_factory=list)
    """Where their noses point [rad]."""
    tints: list[tuple[int, int, int]] = field(default_factory=list)
    """Linear paint colours."""

    def put(self, base_m: Array, yaw_rad: float, draw: np.random.Generator) -> None:
        """Park a car drawn from the fleet."""
        weights = np.array([VEHICLES[name].weight for name in CARS])
        name = CARS[int(draw.choice(len(CARS), p=weights / weights.sum()))]
        tints = VEHICLES[name].tints
        shares = np.array([share for _, share in tints])
        self.names.append(name)
        self.bases_m.append(np.asarray(base_m, dtype=np.float64))
        self.yaws_rad.append(yaw_rad + float(draw.normal(0.0, 0.015)))
        self.tints.append(tints[int(draw.choice(len(tints), p=shares / shares.sum()))][0])

    def footprints(self) -> list[Area]:
        """Plan-view rectangles."""
        cars = zip(self.names, self.bases_m, self.yaws_rad, strict=True)
        return [rectangle(base_m[:2], yaw, *VEHICLES[name].size_m[:2]) for name, base_m, yaw in cars]

    def meshes(self, ids: InstanceIds) -> list[Mesh]:
        """All cars, with an instance id each."""
        meshes = []
        names = np.array(self.names)
        for name in CARS:
            rows = np.flatnonzero(names == name)
            if len(rows):
                T = poses(np.array(self.bases_m)[rows], np.array(self.yaws_rad)[rows])
                paint = np.array(self.tints, dtype=np.float64)[rows] / 255.0
                model, first = vehicle(name).low, ids.take(len(rows))
                meshes.append(_with_plates(copies(model, T, first, paint, tinted=Material.CAR_PAINT)))
        return meshes

    def add_boxes(self, solid: MeshBuilder) -> None:
        """The cars as boxes that others can hit."""
        for name, base_m, yaw in zip(self.names, self.bases_m, self.yaws_rad, strict=True):
            length, width, height = VEHICLES[name].size_m
            box = box_quads([-length / 2, -width / 2, 0.0], [length / 2, width / 2, height])
            placed = turned(box, base_m, yaw)
            placed[..., 2] += base_m[2]
            solid.quads(placed, material=Material.PLAIN, tag=Tag.CAR)


def _with_plates(cars: Mesh) -> Mesh:
    """The cars, each with a number plate of its own in the place of the first one's."""
    rows = np.flatnonzero(cars.material == Material.PLATE)
    origin = np.array([plate_uv(k)[:2] for k in range(PLATES)])
    uv = cars.uv_m.copy()
    uv[rows] += (origin[plate_of(cars.instance[rows])] - origin[0]).astype(np.float32)
    return replace(cars, uv_m=uv)


def rectangle(centre: Array, yaw: float, length: float, width: float) -> Area:
    """Plan-view rectangle about a point."""
    c, s = elementary.cos(yaw), elementary.sin(yaw)
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * 0.5 * np.array([length, width])
    turn = np.array([[c, s], [-s, c]])
    return shapely.Polygon(corners[:, :1] * turn[0] + corners[:, 1:] * turn[1] + centre)


def park_in_lanes(cars: ParkedCars, strips: Sequence[Strip], ways: Waysides, crosswalks: Area) -> None:
    """Cars in parking lanes and on wide shoulders of slow roads in towns."""
    shapely.prepare(crosswalks)
    for strip in strips:
        if strip.junction_id is not None:
            continue
        for lane, record in enumerate(strip.lanes):
            if record.type == "parking" or (record.type == "shoulder" and _walk_beside(strip, lane)):
                _park_lane(cars, strip, lane, ways, crosswalks)


def _walk_beside(strip: Strip, lane: int) -> bool:
    return any(
        0 <= other < len(strip.lanes) and strip.kind(other) == "sidewalk" for other in (lane - 1, lane + 1)
    )


def _park_lane(cars: ParkedCars, strip: Strip, lane: int, ways: Waysides, crosswalks: Area) -> None:
    least = PARKING_WIDTH_M if strip.lanes[lane].type == "parking" else SHOULDER_WIDTH_M
    draw = clock.stream(ways.seed, f"parked/{strip.road_id}/{strip.section}/{lane}")
    left, right = strip.lane_edges(lane)
    width = np.hypot(*(left - right)[:, :2].T)
    middle = 0.5 * (left + right)
    along = distance_along(middle)
    for at in np.arange(JUNCTION_M, along[-1] - JUNCTION_M, SPACE_M):
        taken, wander = draw.random(), float(draw.uniform(-0.5, 0.5))
        span = np.array([at - 2.7, at, at + 2.7]) + wander
        spots = interpolated(span, along, middle)
        kind = ways.zones.kind_at(spots[1])
        if taken > OCCUPIED.get(kind, 0.0) or np.interp(span, along, width).min() < least:
            continue
        if shapely.dwithin(crosswalks, shapely.Point(*spots[1][:2]), CROSSWALK_M):
            continue
        ahead = (spots[2] - spots[0]) * (1.0 if strip.forward(lane) else -1.0)
        cars.put(spots[1], float(elementary.arctan2(ahead[1], ahead[0])), draw)


def park_on_verges(cars: ParkedCars, ways: Waysides, blocked: Area) -> None:
    """Cars on the grass beside slow roads without sidewalks, clear of everything that is paved."""
    shapely.prepare(blocked)
    for edge in ways.edges:
        if edge.sidewalk or edge.limit_mps > SLOWEST_MPS or edge.road_type == "motorway":
            continue
        draw = clock.stream(ways.seed, f"verge/{edge.name}")
        kinds, traffic = ways.zones.kinds_at(edge.line_m), edge.traffic
        for row in np.arange(int(JUNCTION_M), len(edge.line_m) - int(JUNCTION_M), int(SPACE_M) + 1):
            chance = draw.random()
            if edge.state[row] != State.GROUND or chance > VERGES.get(kinds[row], 0.0):
                continue
            xy = edge.line_m[row, :2] + edge.right[row] * (VERGE_M + 1.05)
            yaw = float(elementary.arctan2(traffic[row, 1], traffic[row, 0]))
            if shapely.dwithin(blocked, rectangle(xy, yaw, 6.0, 2.05), 0.12):
                continue
            cars.put(np.array([*xy, float(ways.ground.height(xy[None])[0]) - 0.03]), yaw, draw)


def lay_drives(out: MeshBuilder, cars: ParkedCars, ways: Waysides, blocked: Area) -> list[Area]:
    """Drives between houses with a car on most; returns the ground that they take."""
    shapely.prepare(blocked)
    drives: list[Area] = []
    for edge in ways.edges:
        if not edge.sidewalk:
            continue
        draw = clock.stream(ways.seed, f"drives/{edge.name}")
        kinds = ways.zones.kinds_at(edge.line_m)
        row = int(JUNCTION_M)
        while row < len(edge.line_m) - JUNCTION_M:
            if edge.state[row] == State.GROUND and draw.random() < DRIVES.get(kinds[row], 0.0):
                drive = _drive(out, cars, edge, row, blocked, drives, ways.ground, draw)
                if drive is not None:
                    drives.append(drive)
                    row += int(DRIVE_STEP_M) - 1
            row += 1
    return drives


def _drive(
    out: MeshBuilder,
    cars: ParkedCars,
    edge: RoadEdge,
    row: int,
    blocked: Area,
    others: Sequence[Area],
    ground: Terrain,
    draw: np.random.Generator,
) -> Area | None:
    width, length = DRIVE_M
    away = edge.right[row]
    yaw = float(elementary.arctan2(away[1], away[0]))
    centre = edge.line_m[row, :2] + away * (0.06 + length / 2)
    area = rectangle(centre, yaw, length, width)
    inner = rectangle(centre + 0.3 * away, yaw, length - 0.5, width)
    near = any(shapely.dwithin(area, other, 3.0) for other in others[-9:])
    if near or shapely.dwithin(blocked, inner, 0.15):
        return None
    steps = np.linspace(0.02, length, 6)[:, None]
    side = np.array([-away[1], away[0]]) * width / 2
    middle = edge.line_m[row, :2] + steps * away
    rows = np.stack([middle - side, middle + side], axis=1)
    z = ground.height(rows.reshape(-1, 2)).reshape(6, 2) + 0.02
    grey = float(draw.uniform(190, 235))
    material = (Material.CONCRETE, Material.ASPHALT_OLD, Material.PAVEMENT, Material.GRAVEL)[draw.integers(4)]
    out.grid(
        np.concatenate([rows, z[..., None]], axis=-1), material=material, tag=Tag.GROUND, colour=(grey,) * 3
    )
    if draw.random() < 0.8:
        spot = edge.line_m[row, :2] + away * float(draw.uniform(3.6, 4.8))
        z_car = float(ground.height(spot[None])[0]) + 0.02
        cars.put(np.array([*spot, z_car]), yaw + (np.pi if draw.random() < 0.4 else 0.0), draw)
    return area
