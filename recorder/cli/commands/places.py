"""Compare places of two drives, or of one drive under two weathers: exact overlap, recall at N.

Examples:
  carlaloc places town03.mcap --out places --query-weather RainyNight,FoggyNoon --methods sift_vlad
  carlaloc places first.mcap second.mcap --out places --sensor lidar --methods map_closures
  carlaloc places first.mcap second.mcap --out places --descriptors mine.npz --force
"""

import argparse
from typing import Any

from recorder.cli.arguments import (
    OutputFolder,
    add_stretch_options,
    config_of,
    force_option,
    input_path,
    names,
    number,
    option,
)

TABLES = ("reference.csv", "query.csv", "pairs.csv", "scores.csv", "precision_recall.csv")
"""Files that are written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc places`."""
    parser.add_argument("reference", type=input_path, help="the known drive (.mcap)")
    parser.add_argument("query", type=input_path, nargs="?", help="the drive that looks; else the known one")
    parser.add_argument(
        "--out", type=OutputFolder(*TABLES), required=True, metavar="DIR", help="folder of tables"
    )
    force_option(parser, "older tables")
    parser.add_argument("--sensor", default="camera", help="camera (the rig's first) or lidar")
    parser.add_argument("--rig", default="paper", help="rig of both drives (default: paper)")
    parser.add_argument("--weather", default="ClearNoon", help="weather of the known drive")
    option(parser, "--query-weather", names, "A,B", "weathers of the queries", ("ClearNoon",))
    parser.add_argument("--traffic", default="dynamic", help="traffic level of both")
    option(parser, "--every", number, "M", "distance between frames (default: 2)", 2.0)
    option(parser, "--query-offset", number, "M", "distance to the first query; 0: exact twins", 0.0)
    option(parser, "--within", number, "M", "longest distance of a pair (default: 30)", 30.0)
    option(parser, "--overlap", number, "SHARE", "overlap of one place (default: 0.5)", 0.5)
    option(parser, "--methods", names, "A,B", "sift_vlad, map_closures", ())
    parser.add_argument(
        "--descriptors",
        type=input_path,
        action="append",
        default=[],
        metavar="NPZ",
        help="a method's own file",
    )
    parser.add_argument("--map", metavar="FILE", help="town of the drives, if they do not name it")
    add_stretch_options(parser)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Compare."""
    from recorder.cli.progress import Progress
    from recorder.laboratory.places import PlacesConfig, compare_places

    config = config_of(
        PlacesConfig, arguments, query_weathers=arguments.query_weather, least_overlap=arguments.overlap,
        descriptors=tuple(arguments.descriptors),
    )  # fmt: skip
    with Progress("places", unit="frames") as progress:
        result = compare_places(config, progress.update)
    return {
        "references": len(result.reference),
        "queries": len(result.query),
        "pairs": len(result.pairs.query),
        "scores": [
            {
                "method": method,
                "query_weather": weather,
                "queries": score.queries,
                "recall": {str(n): value for n, value in score.recall.items()},
                "average_precision": score.average_precision,
                "recall_at_full_precision": score.recall_at_full_precision,
            }
            for (method, weather), score in result.scores.items()
        ],
        "files": [str(path) for path in result.files],
    }


def show(result: dict[str, Any]) -> None:
    """Print counts, a line for each method and weather, and the files."""
    print(f"{result['queries']} queries, {result['references']} references, {result['pairs']} pairs")
    for row in result["scores"]:
        recall = ", ".join(f"@{n} {value:.3f}" for n, value in row["recall"].items())
        print(
            f"  {row['method']:<14} {row['query_weather']:<16} recall {recall} of {row['queries']} queries; "
            f"average precision {row['average_precision']:.3f}"
        )
    print(*result["files"], sep="\n")
