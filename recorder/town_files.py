"""Files of towns: the folder of a town made of an extract of OpenStreetMap, and a town's surfaces."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.files.output_paths import check_output_folder
from carlaloc_env.openstreetmap import import_town as extracts
from carlaloc_env.scene.mesh import merge
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from recorder.laboratory.surface_cloud import Region, sample_surface, write_cloud, write_mesh
from recorder.replaying.cost import SIZE_ERROR, TIME_FACTOR
from recorder.replaying.machine_speed import slowness
from recorder.report.town_preview import draw_town

STEPS = (4, 5)
"""Steps of an import, and those that the preview adds."""
TOWN_BYTES, PREVIEW_BYTES, KM_BYTES = 1.5e5, 2.75e6, 1.65e5
"""Size of a town's files, of its preview, and of a kilometre of its streets [bytes]."""
TOWN_S, TOWN_KM_S, PREVIEW_S, PREVIEW_KM_S = 2.8, 0.45, 14.0, 3.5
"""CPU time of an import, of a kilometre of streets, and what the preview adds to both [s]."""


def import_town(
    source: Path,
    out: Path,
    *,
    box: tuple[float, float, float, float] | None = None,
    name: str = "",
    heights: Path | None = None,
    preview: bool = True,
    announce: Callable[[str], object] = lambda _: None,
    progress: Callable[[int, int, str], object] = lambda *_: None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Make a town of an extract of OpenStreetMap, and return the report on it.

    Args:
        source: An .osm, .osm.gz, .osm.bz2 or .osm.pbf file.
        out: Folder of the town; its map is `town.xodr`.
        box: West, south, east, north [deg]; None: the whole file.
        name: Name of the town; empty: that of the file.
        heights: Raster of the land's heights; None: a flat town.
        preview: Build the town and draw `preview.png`.
        announce: Called with size and time when the streets are known.
        progress: Called with the steps done, those in all, and the one that has ended.
        overwrite: Replace an older town there.

    Raises:
        MapError: the extract cannot be read, or holds no streets on which one could drive.
        OutputError: a file is there already.
        MissingDependencyError: heights need rasterio.
    """
    check_output_folder(out, files=extracts.FILES, overwrite=overwrite)

    def announce_streets(streets_m: float) -> None:
        size = TOWN_BYTES + PREVIEW_BYTES * preview + KM_BYTES * streets_m / 1e3
        cpu_s = TOWN_S + PREVIEW_S * preview + (TOWN_KM_S + PREVIEW_KM_S * preview) * streets_m / 1e3
        error = SIZE_ERROR if preview else 1.5 * SIZE_ERROR
        announce(
            f"{streets_m / 1e3:.1f} km of streets: about {size / 1e6:.1f} MB (±{error:.0%}) and "
            f"{slowness() * cpu_s:.0f} s of CPU time (a factor of {TIME_FACTOR})"
        )

    total = STEPS[0] + STEPS[1] * preview
    count = itertools.count(1)

    def end(step: str) -> None:
        progress(min(next(count), total), total, step)

    town = extracts.import_town(
        source, box=box, name=name, heights=heights, fit_turns=fit_turns, announce=announce_streets,
        progress=end,
    )  # fmt: skip
    extracts.write_town(town, out)
    end(f"{extracts.FILES[0]} written")
    if preview:
        draw_town(load_town(out / "town.xodr", progress=end), out / "preview.png", overwrite=True)
        end("preview drawn")
    return town.report


def export_town(
    town: Town,
    *,
    mesh: Path | None = None,
    cloud: Path | None = None,
    points_per_m2: float = 10.0,
    reach_m: float = 50.0,
    seed: int = 0,
) -> dict[str, int]:
    """Write the surfaces of a town as a mesh and as a labelled cloud, and return what was written.

    Args:
        town: The town.
        mesh: File of the triangles, .ply or .gltf; None: none.
        cloud: File of the points, .ply; None: none.
        points_per_m2: Points per area [1/m²].
        reach_m: Points lie so near a driving lane [m].
        seed: Seed of the points.

    Returns:
        Numbers of `triangles` and of `points`.

    Raises:
        OutputError: a file cannot be written.
    """
    surfaces, points = merge(town.chunks), 0
    if cloud is not None:
        lanes = town.network.waypoints(2.0)
        region = Region(np.column_stack([lanes["x"], lanes["y"]]), reach_m)
        sampled = sample_surface(surfaces, points_per_m2=points_per_m2, seed=seed, region=region)
        write_cloud(sampled, cloud)
        points = len(sampled)
    if mesh is not None:
        write_mesh(surfaces, mesh)
    return {"triangles": len(surfaces.triangles), "points": points}
