"""A town as a recording of rerun: its solid parts by class, lanes, route and traffic lights."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.semantic_tags import PALETTE_RGB, Tag
from carlaloc_env.town.town import Town
from recorder.report.lane_lines import lane_lines
from recorder.view.recording import WORLD, Recording, new_recording

LANE, ROUTE = (60, 210, 255), (255, 120, 20)
"""Colours of lanes and of the route."""


def record_town(town: Town, path: Path, *, overwrite: bool = False) -> Path:
    """Write a town as a recording.

    Raises:
        OutputError: the file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    with new_recording(path, town.name, overwrite=overwrite) as recording:
        log_town(recording, town)
        recording.show(recording.rerun.blueprint.Spatial3DView(origin=WORLD, name=town.name))
    return path


def log_town(recording: Recording, town: Town) -> None:
    """Log everything solid, an entity for each class, then lanes, the route and signal lenses."""
    rerun = recording.rerun
    solid = town.outline
    for tag in np.unique(solid.collision_tags).tolist():
        corners = solid.collision_vertices_m[solid.collision_triangles[solid.collision_tags == tag]]
        recording.always(
            f"{WORLD}/town/{Tag(tag).name.lower()}",
            rerun.Mesh3D(
                vertex_positions=corners.reshape(-1, 3),
                vertex_normals=np.repeat(_normals(corners), 3, axis=0),
                albedo_factor=PALETTE_RGB[tag],
            ),
        )
    log_lanes(recording, lane_lines(town.network))
    if town.route is not None:
        recording.path(f"{WORLD}/route", town.route.position_m + np.array([0.0, 0.0, 0.3]), ROUTE, 0.3)
    lenses = solid.lenses
    if len(lenses):
        colours = np.array([(40, 40, 40), (255, 40, 40), (255, 210, 40), (40, 230, 80)], np.uint8)
        recording.always(
            f"{WORLD}/signal_lenses",
            rerun.Points3D(lenses.T_world_lens[:, :3, 3], colors=colours[lenses.state], radii=[0.15]),
        )


def log_lanes(recording: Recording, lines_m: Sequence[Array]) -> None:
    """Log the centre lines of driving lanes, if there are some."""
    if lines_m:
        above = [line + np.array([0.0, 0.0, 0.1]) for line in lines_m]
        recording.always(f"{WORLD}/lanes", recording.rerun.LineStrips3D(above, colors=[LANE], radii=[0.08]))


def _normals(corners_m: Array) -> Array:
    """Unit normals of triangles (T, 3, 3), shape (T, 3)."""
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    unit: Array = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return unit
