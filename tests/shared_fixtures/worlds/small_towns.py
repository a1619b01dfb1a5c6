"""Towns of a few straight roads, built once, and rays through them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.construction import build_scenery
from carlaloc_env.scenery.ground.lane_strips import road_strips
from carlaloc_env.scenery.outline import TownScenery

STREET = (("driving", 3.5), ("driving", 3.5), ("sidewalk", 2.5))


LANE = (("driving", 3.5), ("sidewalk", 2.5))


MOTORWAY = (("median", 1.5), ("driving", 3.7), ("driving", 3.7), ("shoulder", 2.5))


RURAL = (("driving", 3.5), ("shoulder", 1.0))


KERBSIDE = (("driving", 3.5), ("parking", 2.2), ("sidewalk", 2.5))


def climb(s: float, z0: float, z1: float, length: float) -> tuple[float, ...]:
    """One cubic with level ends."""
    rise = z1 - z0
    return (s, z0, 0.0, 3 * rise / length**2, -2 * rise / length**3)


def straight_road(
    number: int,
    start: tuple[float, float, float],
    length: float,
    elevation: tuple[tuple[float, ...], ...],
    lanes: tuple[tuple[str, float], ...],
    kmh: int = 50,
    links: tuple[int | None, int | None] = (None, None),
) -> str:
    """One straight road, the same on both sides."""

    def side(sign: int) -> str:
        found = [
            f'<lane id="{sign * (k + 1)}" type="{kind}" level="false">'
            f'<width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'
            for k, (kind, width) in enumerate(lanes)
        ]
        return "".join(found[::-sign])

    heights = "".join('<elevation s="{}" a="{}" b="{}" c="{}" d="{}"/>'.format(*e) for e in elevation)
    link = "".join(
        f'<{name} elementType="road" elementId="{other}" contactPoint="{contact}"/>'
        for name, other, contact in (("predecessor", links[0], "end"), ("successor", links[1], "start"))
        if other is not None
    )
    x, y, heading = start
    return (
        f'<road name="{number}" length="{length}" id="{number}" junction="-1"><link>{link}</link>'
        f'<type s="0" type="town"><speed max="{kmh}" unit="km/h"/></type><planView>'
        f'<geometry s="0" x="{x}" y="{y}" hdg="{heading}" length="{length}"><line/></geometry></planView>'
        f'<elevationProfile>{heights}</elevationProfile><lanes><laneSection s="0"><left>{side(1)}</left>'
        f'<center><lane id="0" type="none" level="false"/></center><right>{side(-1)}</right>'
        "</laneSection></lanes></road>"
    )


@dataclass(frozen=True)
class Built:
    """A map and its scenery."""

    network: LaneNetwork
    scenery: TownScenery | None
    mesh: Mesh

    def scene(self, *tags: Tag) -> Any:
        """Triangles of some tags, for rays; of all when left out."""
        o3d = pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")
        triangles = self.mesh.triangles
        if tags:
            triangles = triangles[np.isin(self.mesh.tag[triangles[:, 0]], tags)]
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(
            o3d.core.Tensor(self.mesh.vertices_m), o3d.core.Tensor(triangles.astype(np.uint32))
        )
        return scene

    def corners(self, *tags: Tag) -> Array:
        """Corners of the triangles of some tags."""
        triangles = self.mesh.triangles[np.isin(self.mesh.tag[self.mesh.triangles[:, 0]], tags)]
        return self.mesh.vertices_m[triangles].reshape(-1, 3).astype(np.float64)

    def lane_area(self, *kinds: str) -> shapely.Geometry:
        """Plan-view area of all lanes of some types."""
        strips = road_strips(self.network.xodr.roads, self.network.surface)
        parts = []
        for strip in strips:
            for lane in range(len(strip.lanes)):
                if strip.lanes[lane].type in kinds:
                    left, right = strip.lane_edges(lane)
                    parts.append(shapely.Polygon(np.concatenate([left[:, :2], right[::-1, :2]])))
        return shapely.union_all(parts)

    def lanes(self, only: list[int] | None = None) -> Array:
        """Points (M, 3) of driving lanes at the middle and near both edges, every metre."""
        found = []
        for lane in self.network.lanes:
            if lane.type == "driving" and lane.length_m > 1.5 and (only is None or lane.index in only):
                station = np.arange(0.5, lane.length_m - 0.4, 1.0)
                pose = self.network.pose([lane.index] * len(station), station)
                width = self.network.width_m([lane.index] * len(station), station)
                number = np.full(len(station), lane.index)
                bank = self.network.surface.lane_bank(number, self.network.s_m(number, station))
                bank *= 1.0 if lane.forward else -1.0
                left = np.stack([-np.sin(pose.heading_rad), np.cos(pose.heading_rad), bank], axis=-1)
                found += [pose.position_m + (share * width)[:, None] * left for share in (-0.45, 0.0, 0.45)]
        return np.concatenate(found)


def build_small(folder: Path, roads: list[str], toml: str) -> Built:
    """A town of some roads, with the settings of its town.toml."""
    folder.mkdir(exist_ok=True)
    text = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7" name="small"/>'
    (folder / "town.xodr").write_text(text + "".join(roads) + "</OpenDRIVE>")
    (folder / "town.toml").write_text(toml)
    network = build_network(folder / "town.xodr")
    scenery = build_scenery(network, TownConfig.from_toml(folder / "town.toml"), 7)
    return Built(network, scenery, merge(scenery.chunks))


@pytest.fixture(scope="session")
def overpass(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """A street over two others: up on one road, along on the next, down on a third."""
    north = np.pi / 2
    roads = [
        straight_road(1, (0.0, -200.0, north), 100.0, (climb(0, 0, 6.5, 100),), STREET, links=(None, 2)),
        straight_road(2, (0.0, -100.0, north), 160.0, ((0, 6.5, 0, 0, 0),), STREET, links=(1, 3)),
        straight_road(3, (0.0, 60.0, north), 100.0, (climb(0, 6.5, 0, 100),), STREET, links=(2, None)),
        straight_road(4, (-120.0, -50.0, 0.0), 240.0, ((0, 0, 0, 0, 0),), LANE),
        straight_road(5, (-120.0, 30.0, 0.0), 240.0, ((0, 0, 0, 0, 0),), LANE),
    ]
    return build_small(tmp_path_factory.mktemp("over"), roads, '[town]\ndefault_zone = "industrial"\n')


@pytest.fixture(scope="session")
def motorway(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """A motorway with a country road over it, on banks."""
    over = (climb(0, 0, 6.8, 130), (130, 6.8, 0, 0, 0), climb(190, 6.8, 0, 130))
    roads = [
        straight_road(1, (-200.0, 0.0, 0.0), 400.0, ((0, 0, 0, 0, 0),), MOTORWAY, kmh=120),
        straight_road(2, (20.0, -160.0, np.pi / 2), 320.0, over, RURAL, kmh=80),
    ]
    return build_small(tmp_path_factory.mktemp("way"), roads, '[town]\ndefault_zone = "highway"\n')


@pytest.fixture(scope="session")
def river(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """A street over a river, and a quiet street with parking lanes."""
    roads = [
        straight_road(1, (-120.0, 0.0, 0.0), 240.0, ((0, 0.5, 0, 0, 0),), LANE),
        straight_road(2, (-120.0, -90.0, 0.0), 100.0, ((0, 0.5, 0, 0, 0),), KERBSIDE, kmh=30),
    ]
    toml = (
        '[town]\ndefault_zone = "residential"\n[[zone]]\nkind = "water"\n'
        "polygon = [[10, -400], [42, -400], [40, 0], [48, 400], [16, 400], [8, 0]]\n"
    )
    return build_small(tmp_path_factory.mktemp("river"), roads, toml)


def cast(scene: Any, points: Array, direction: tuple[float, ...]) -> Array:
    """Distances [m] at which rays from points (N, 3) meet something, (N,)."""
    import open3d as o3d

    rays = np.concatenate([points, np.tile(direction, (len(points), 1))], axis=1).astype(np.float32)
    return np.asarray(scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy(), dtype=np.float64)
