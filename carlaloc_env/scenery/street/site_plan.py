"""The ground beside the roads, shared among features, car parks and buildings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.buildings.building_lots import Lot, place_lots
from carlaloc_env.scenery.buildings.buildings import building_mesh
from carlaloc_env.scenery.buildings.footprints import Houses
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.ground_plan import Groundwork
from carlaloc_env.scenery.ground.road_edges import Waysides, road_edges
from carlaloc_env.scenery.ground.terrain import BANK_SLOPE, Terrain
from carlaloc_env.scenery.mapped import MappedFeature, of_kind
from carlaloc_env.scenery.meshing.props import InstanceIds, poses
from carlaloc_env.scenery.street.car_parks import CarPark, place_car_parks
from carlaloc_env.scenery.street.features import Site, feature_car_parks, sites
from carlaloc_env.scenery.street.mapped_scenery import paved_grounds

OVERHEAD_CLEAR_M = 2.5
"""Distance of buildings and trees from raised roads [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plots:
    """The ground beside the roads and what stands on it."""

    features: list[Site]
    """Features that `town.toml` asks for."""
    waysides: Waysides
    """Edges of the roads and the ground beside them."""
    car_parks: list[CarPark]
    """Car parks."""
    reserved: Area
    """Ground of features, car parks, cuts and waters."""
    lots: list[Lot]
    """Buildings with their ground."""
    bases_m: list[float]
    """Heights of the buildings' floors [m]."""
    mapped: Sequence[MappedFeature] | None = None
    """Things beside the roads, where they are known."""
    houses: Houses | None = None
    """Houses of these, in place of lots."""

    def footprints(self) -> list[Area]:
        """Ground under each building."""
        houses = [] if self.houses is None else self.houses.footprints()
        return [*(lot.footprint() for lot in self.lots), *houses]

    def mapped_boxes(self) -> Array:
        """Walls of houses on given outlines, as coarse faces (N, 4, 3)."""
        return np.zeros((0, 4, 3)) if self.houses is None else self.houses.boxes()

    def buildings(self, seed: int, ids: InstanceIds) -> list[Mesh]:
        """Meshes of all buildings, with an instance id each."""
        meshes = [] if self.houses is None else self.houses.meshes(ids)
        for lot, base in zip(self.lots, self.bases_m, strict=True):
            mesh = building_mesh(lot.plan, clock.stream(seed, lot.name, index=1), instance=ids.take())
            meshes.append(mesh.transformed(poses((*lot.corner_m, base), lot.heading_rad)[0]))
        return meshes


def place_plots(
    work: Groundwork, config: TownConfig, seed: int, mapped: Sequence[MappedFeature] | None = None
) -> Plots:
    """Share out the ground beside the roads; mapped things stand in place of lots and car parks."""
    features = sites(config.features)
    reserved = shapely.union_all([_cuts(work), *(site.ground for site in features)])
    edges = road_edges(work.strips, work.roads, work.levels)
    ways = Waysides(edges=edges, zones=work.zones, ground=work.ground, seed=seed)
    parks, houses, areas = feature_car_parks(config.features), None, work.areas
    if mapped is None:
        parks += place_car_parks(ways, shapely.union(areas.paved, reserved))
    else:
        reserved = shapely.union(reserved, paved_grounds(mapped))
        outlines = of_kind(mapped, "building", "part")
        houses = Houses(outlines, work.zones, areas.roadway, areas.paved, work.ground, seed)
    reserved = shapely.union_all([reserved, *(park.area() for park in parks)])
    lots = []
    if mapped is None:
        lots = place_lots(work.strips, shapely.union(areas.paved, reserved), work.zones, seed)
    return Plots(
        features=features,
        waysides=ways,
        car_parks=parks,
        reserved=reserved,
        lots=lots,
        bases_m=_base_heights(lots, work.ground),
        mapped=mapped,
        houses=houses,
    )


def _cuts(work: Groundwork) -> Area:
    """Sunken and raised stretches with room for their walls, embankments and waters."""
    levels = work.levels
    parts = [s.area(np.ones(len(s.left_m), bool), 1.0) for s in levels.stretches]
    parts += [water.area for water in levels.waters]
    parts.append(shapely.buffer(work.overhead, OVERHEAD_CLEAR_M))
    banks = levels.area(State.BANK)
    if not banks.is_empty:
        high = levels.lift_m[levels.state == State.BANK].max()
        parts.append(shapely.buffer(banks, BANK_SLOPE * high + 1.0))
    return shapely.union_all(parts)


def _base_heights(lots: Sequence[Lot], ground: Terrain) -> list[float]:
    """Height of each building's floor: the mean of the ground along its front."""
    bases = []
    for lot in lots:
        along = np.array([elementary.cos(lot.heading_rad), elementary.sin(lot.heading_rad)])
        points = lot.corner_m + np.linspace(0.0, lot.plan.width_m, 5)[:, None] * along
        bases.append(float(ground.height(points).mean()))
    return bases
