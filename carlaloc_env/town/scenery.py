"""Everything that stands still in a town, built from its map."""

from __future__ import annotations

import numpy as np
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material, Tag
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.town.buildings.building_lots import lot_boxes
from carlaloc_env.town.buildings.skyline import add_skyline
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.meshing.collision_mesh import weld
from carlaloc_env.town.meshing.instance_ids import InstanceIds
from carlaloc_env.town.meshing.tiles import FAR_CHUNK_M, split_chunks
from carlaloc_env.town.roads.surfaces import Surfaces, add_surfaces
from carlaloc_env.town.street.scene_dressing import dress
from carlaloc_env.town.street.site_plan import place_plots
from carlaloc_env.town.town_scenery import TownScenery


def build_scenery(
    network: LaneNetwork, config: TownConfig, seed: int, route_m: Array | None = None
) -> TownScenery:
    """Scenery of a map; the same map, configuration and seed give the same bytes."""
    work, out = lay_groundwork(network, config), Surfaces()
    tunnel_lamps = add_surfaces(out, network, work, seed)
    plots = place_plots(work, config, seed)
    out.solid.quads(lot_boxes(plots.lots, plots.bases_m), material=Material.PLAIN, tag=Tag.BUILDING)
    ids = InstanceIds()
    buildings = plots.buildings(seed, ids)
    dressing = dress(out, network, work, plots, config, route_m, seed, ids)
    firm = out.raised.build()
    vertices, triangles, tags = weld([out.solid.build(), firm])
    near = [out.lanes.build(), firm, dressing.cover, out.paint.build(), *buildings]
    far = _far_town(work, seed, ids)
    return TownScenery(
        chunks=split_chunks(merge([*near, *dressing.meshes])) + split_chunks(merge(far), FAR_CHUNK_M),
        collision_vertices_m=vertices,
        collision_triangles=triangles,
        collision_tags=tags,
        lenses=dressing.lenses,
        road_events=np.concatenate(out.events),
        lamps_m=np.concatenate([dressing.lamps_m, tunnel_lamps]),
    )


def _far_town(work: Groundwork, seed: int, ids: InstanceIds) -> list[Mesh]:
    seas = shapely.union_all([sea for sea, _ in work.seas])
    return add_skyline(work.bounds, work.zones, work.ground, seed, ids, seas)
