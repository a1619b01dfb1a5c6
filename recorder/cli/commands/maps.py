"""Towns: list them, import them from OpenStreetMap, draw them, export their surfaces, check OpenDRIVE files.

Examples:
  carlaloc maps list
  carlaloc maps import krems.osm.gz --out krems
  carlaloc maps preview Town03 --out town03.png
  carlaloc maps export Town03 --mesh town03.gltf --cloud town03.ply
  carlaloc maps check my.xodr --waypoints 2 --csv waypoints.csv
"""

import argparse
from dataclasses import asdict
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError
from recorder.cli.arguments import (
    OutputFile,
    OutputFolder,
    force_option,
    input_path,
    number,
    numbers,
    option,
    positive_seconds,
    seed,
    shared_options,
)
from recorder.cli.output import announced
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Sub-commands of `carlaloc maps`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    shared = [shared_options(nested=True)]
    actions.add_parser("list", parents=shared, help="names and sizes of all towns")
    imported = actions.add_parser("import", parents=shared, help="a town from an extract of OpenStreetMap")
    imported.add_argument("file", type=input_path, help=".osm, .osm.gz, .osm.bz2 or .osm.pbf")
    files = OutputFolder(
        "town.xodr", "town.toml", "features.geojson", "LICENCE", "report.json", "preview.png"
    )
    imported.add_argument("--out", type=files, required=True, help="folder of the town")
    option(imported, "--bbox", numbers, "W,S,E,N", "part of the file, in degrees")
    option(imported, "--heights", input_path, "RASTER", "heights of the land, such as a GeoTIFF")
    imported.add_argument("--name", default="", metavar="NAME", help="the town's name (default: the file's)")
    imported.add_argument(
        "--no-preview", action="store_true", help="draw no preview.png, which builds the town"
    )
    force_option(imported, "an older town")
    preview = actions.add_parser("preview", parents=shared, help="a town from above and from its streets")
    preview.add_argument("town", help="town, or a .xodr file")
    preview.add_argument(
        "--out", type=OutputFile(".png", ".jpg", ".jpeg"), required=True, help="PNG or JPEG to write"
    )
    force_option(preview, "an older picture")
    export = actions.add_parser("export", parents=shared, help="surfaces of a town, as mesh and as cloud")
    export.add_argument("town", help="town, or a .xodr file")
    option(export, "--mesh", OutputFile(".ply", ".gltf"), "OUT", "triangles of the whole town")
    option(export, "--cloud", OutputFile(".ply"), "OUT", "labelled points, normals")
    option(export, "--points-per-m2", number, "N", "(default: 10)", 10.0)
    option(export, "--reach", number, "M", "points so near a driving lane (default: 50)", 50.0)
    export.add_argument("--seed", type=seed, default=0, help="seed of the points")
    export.add_argument("--empty", action="store_true", help="without parked cars")
    force_option(export, "older files")
    check = actions.add_parser("check", parents=shared, help="problems of an OpenDRIVE file")
    check.add_argument("file", type=input_path, help="OpenDRIVE file")
    option(check, "--waypoints", positive_seconds, "STEP_M", "list waypoints [m]")
    check.add_argument("--strict", action="store_true", help="end with 1 for warnings, too")
    check.add_argument("--all", action="store_true", help="list every problem; else the first of its kind")
    option(check, "--csv", OutputFile(".csv"), "OUT", "where waypoints go (.csv)")
    force_option(check, "an older table")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """List, import, draw, export or check."""
    actions = {"list": _list, "import": _import, "preview": _preview, "export": _export, "check": _check}
    action = actions[arguments.action]
    return {"action": arguments.action, **action(arguments)}


def show(result: dict[str, Any]) -> None:
    """Print the result of the action."""
    if result["action"] == "list":
        for town in result["towns"]:
            size = f"{town['lane_km']:.1f} lane-km, {town['junctions']} junctions"
            print(f"{town['name']:<8} {size}, route {town['route_m']:.0f} m  {town['description']}")
    elif result["action"] == "import":
        _show_import(result)
    elif result["action"] == "preview":
        print(result["out"])
    elif result["action"] == "export":
        counts = {"mesh": ("triangles", "triangles"), "cloud": ("points", "points")}
        for kind, (key, unit) in counts.items():
            if result[kind]:
                print(f"{result[kind]}: {result[key]:,} {unit}")
    else:
        report = result["report"]
        print(*result["lines"], sep="\n", end="\n" if result["lines"] else "")
        origin = report["origin"]
        print(
            f"{report['source']}: OpenDRIVE {report['revision']}, {report['roads']} roads, "
            f"{report['junctions']} junctions, {report['lane_km']:.2f} lane-km, "
            f"{report['signals']} signals; origin {origin['latitude_deg']:.6f}° N, "
            f"{origin['longitude_deg']:.6f}° E, world y {origin['azimuth_deg']:+.2f}° from true north; "
            f"{result['errors']} errors, {len(report['problems']) - result['errors']} warnings"
        )
        if result["csv"]:
            print(result["csv"])


def _list(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.report.town_list import list_towns

    return {"towns": [asdict(town) for town in list_towns()]}


def _show_import(result: dict[str, Any]) -> None:
    report = result["report"]
    share = 100.0 * report["built_m"] / max(report["streets_m"], 1)
    print(
        f"{result['out']}: {report['built_m'] / 1000:.1f} of {report['streets_m'] / 1000:.1f} km of streets "
        f"({share:.0f} %), {report['junctions']} junctions, {report['buildings']} buildings, "
        f"traffic on the {report['drives_on']}; {len(report['left_out'])} things left out and "
        f"{len(report['changed'])} changed, all in report.json"
    )
    print(report["attribution"])


def _import(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.town_files import import_town

    if arguments.bbox is not None and len(arguments.bbox) != 4:
        raise UsageError(f"--bbox has {len(arguments.bbox)} numbers; give W,S,E,N in degrees")
    with Progress("import", unit="steps") as progress:
        report = import_town(
            arguments.file, arguments.out, box=arguments.bbox, name=arguments.name, heights=arguments.heights,
            preview=not arguments.no_preview, announce=announced, progress=progress.pieces,
            overwrite=arguments.force,
        )  # fmt: skip
    return {"out": str(arguments.out), "report": report}


def _preview(arguments: argparse.Namespace) -> dict[str, Any]:
    from carlaloc_env.town.build import load_town
    from recorder.report.town_preview import draw_town

    return {"out": str(draw_town(load_town(arguments.town), arguments.out, overwrite=arguments.force))}


def _export(arguments: argparse.Namespace) -> dict[str, Any]:
    from carlaloc_env.town.build import load_town
    from carlaloc_env.town.town import without_movables
    from recorder.town_files import export_town

    files = {"mesh": arguments.mesh, "cloud": arguments.cloud}
    if not any(files.values()):
        raise UsageError("nothing to export; give --mesh OUT, --cloud OUT or both")
    town = load_town(arguments.town)
    counts = export_town(
        without_movables(town) if arguments.empty else town, **files, points_per_m2=arguments.points_per_m2,
        reach_m=arguments.reach, seed=arguments.seed,
    )  # fmt: skip
    return {kind: str(path) if path else None for kind, path in files.items()} | counts


def _check(arguments: argparse.Namespace) -> dict[str, Any]:
    from carlaloc_env.map.checks.report import check_map, grouped, write_waypoints_csv

    if (arguments.waypoints is None) != (arguments.csv is None):
        raise ConfigError("--waypoints STEP_M and --csv OUT go together; give both")
    report = check_map(arguments.file)
    if arguments.csv is not None:
        from carlaloc_env.map.lanes.build_network import build_network
        from carlaloc_env.map.opendrive.reader import read_opendrive

        network = build_network(read_opendrive(arguments.file))
        write_waypoints_csv(network, arguments.waypoints, arguments.csv, overwrite=arguments.force)
    groups = [(p, 1) for p in report.problems] if arguments.all else grouped(report.problems)
    return {
        "report": report.as_dict(),
        "lines": [f"{p} ({n} of this kind; --all lists them)" if n > 1 else str(p) for p, n in groups],
        "errors": len(report.errors),
        "csv": str(arguments.csv) if arguments.csv is not None else None,
        "failed": bool(report.problems if arguments.strict else report.errors),
    }
