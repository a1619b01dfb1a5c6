"""Builds the scenery of a town from its map: ground, roads, buildings and plants."""

from collections.abc import Callable, Sequence

import numpy as np
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.building_lots import lot_boxes
from carlaloc_env.scenery.buildings.skyline import add_skyline
from carlaloc_env.scenery.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.scenery.mapped import MappedFeature, land_points
from carlaloc_env.scenery.meshing.chunks import FAR_CHUNK_M, split_chunks
from carlaloc_env.scenery.meshing.collision_mesh import weld
from carlaloc_env.scenery.meshing.props import InstanceIds
from carlaloc_env.scenery.outline import TownScenery
from carlaloc_env.scenery.roads.surfaces import Surfaces, add_surfaces
from carlaloc_env.scenery.street.scene_dressing import dress
from carlaloc_env.scenery.street.site_plan import place_plots


def build_scenery(
    network: LaneNetwork,
    config: TownConfig,
    seed: int,
    route_m: Array | None = None,
    mapped: Sequence[MappedFeature] | None = None,
    progress: Callable[[str], object] = lambda _: None,
) -> TownScenery:
    """Scenery of a map; the same map, configuration, seed and features give the same bytes.

    Args:
        network: Lanes of the map.
        config: Settings.
        seed: Number from which all that is not given is drawn.
        route_m: Points of the ego's route (N, 2) [m].
        mapped: Things beside the roads; None: houses and plants are invented.
        progress: Called with the name of each step that has ended.
    """
    work, out = lay_groundwork(network, config, land_points(mapped or ())), Surfaces()
    progress("ground laid")
    tunnel_lamps = add_surfaces(out, network, work, seed)
    progress("surfaces built")
    plots = place_plots(work, config, seed, mapped)
    boxes = np.concatenate([lot_boxes(plots.lots, plots.bases_m), plots.mapped_boxes()])
    out.solid.quads(boxes, material=Material.PLAIN, tag=Tag.BUILDING)
    ids = InstanceIds()
    buildings = plots.buildings(seed, ids)
    progress("houses built")
    dressing = dress(out, network, work, plots, config, route_m, seed, ids)
    progress("streets furnished")
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
