"""Find where a SLAM system breaks: the mildest weather, traffic and faults in which it fails.

Examples:
  carlaloc break kiss_icp drive.mcap --rig lidar
  carlaloc break rko_lio drive.mcap --rig lidar --ape-max 1 --over fault.lidar.time_offset_ms=0:200
  carlaloc benchmark drive.mcap --rig lidar --methods kiss_icp --condition drive-break/broken.yaml
"""

import argparse
from typing import Any

from carlaloc_env.core.errors import UsageError
from recorder.cli.arguments import (
    OutputFolder,
    add_condition_options,
    config_of,
    drive_config,
    input_path,
    number,
    option,
    positive_int,
    positive_seconds,
)
from recorder.cli.commands.benchmark import check_tools
from recorder.cli.progress import Progress

NOTE = """It writes the counter-example as a bag and a film, its condition, the nearest one that passes,
and all tries. Tries are kept: the same command resumes the search."""
"""Text below the options of ``--help``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc break`."""
    parser.epilog = NOTE
    parser.add_argument("method", help="system, or a .py or .yaml file")
    parser.add_argument("drive", type=input_path, help="drive (.mcap)")
    parser.add_argument("--out", type=OutputFolder(), help="results; else DRIVE-break beside it")
    parser.add_argument(
        "--over",
        action="append",
        default=[],
        metavar="NAME=NEUTRAL:WORST",
        help="a quantity to search; else weather, traffic and all faults of the system's sensors",
    )
    option(parser, "--tries", positive_int, "N", "tries (default: 60)", 60)
    option(parser, "--stretch", positive_seconds, "S", "length of a try [s] (default: 10)", 10.0)
    option(parser, "--stretches", positive_int, "N", "stretches (default: 3)", 3)
    option(parser, "--ape-max", number, "M", "a larger APE is a failure, too [m]")
    parser.add_argument("--seed", type=int, default=0, help="seed of sensor noise and of the search")
    parser.add_argument("--map", help="map of the drive, where the episode names none that is known")
    add_condition_options(parser, weathers=("ClearNoon",), traffic=("dynamic",))


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Search."""
    check_tools()
    import numpy as np

    from recorder.episode.episode import Episode
    from recorder.laboratory.breaking import (
        BreakConfig,
        Try,
        find_break,
        write_counter_example,
    )
    from recorder.laboratory.search_space import Range, ranges_of
    from recorder.laboratory.sweep import Axis, SweepConfig
    from recorder.slam.systems import system_of

    system, drive = system_of(arguments.method), arguments.drive.resolve()
    last_s = Episode.load(drive).duration_s - arguments.stretch
    if last_s < 0:
        raise UsageError(
            f"the drive is shorter than a try of {arguments.stretch:g} s; give a smaller --stretch"
        )
    starts = np.linspace(0.0, last_s, arguments.stretches + 2)[1:-1].round(1)
    kinds = tuple("camera" if need == "stereo" else need for need in system.needs)
    out = arguments.out or drive.with_name(f"{drive.stem}-break")
    drives = drive_config(arguments, [drive])
    config = config_of(
        BreakConfig,
        arguments,
        sweep=SweepConfig(drives=drives, out=out, axes=(Axis(name="traffic", values=(1.0,)),), seeds=1),
        ranges=tuple(map(Range.parse, arguments.over)) or ranges_of(kinds, weather=True),
        starts_s=tuple(starts.tolist()),
    )
    done = 0
    with Progress("tries", unit="tries") as progress:

        def report(tried: Try) -> None:
            nonlocal done
            done += 1
            progress.pieces(done, config.tries, f"distance {tried.distance:.3f}: {tried.failed or 'passes'}")

        result = find_break(config, report)
    files = write_counter_example(result, config, out)

    def about(tried: Try | None) -> dict[str, Any] | None:
        if tried is None:
            return None
        values = {r.name: r.value(tried.shares[r.name]) for r in config.ranges if r.name in tried.shares}
        return {"distance": tried.distance, "start_s": tried.start_s, "values": values,
                "failed": tried.failed, "ape_m": tried.score.ape_m,
                "coverage": tried.score.coverage}  # fmt: skip

    return {
        "out": str(out),
        "files": [str(path) for path in files],
        "tries": len(result.tries),
        "broken": about(result.broken),
        "passes": about(result.passes),
    }


def show(result: dict[str, Any]) -> None:
    """Print the counter-example, the nearest condition that passes, and the files."""
    for name, word in (("broken", "mildest failure"), ("passes", "nearest pass")):
        if (row := result[name]) is None:
            print(f"{word}: none in {result['tries']} tries")
            continue
        values = ", ".join(f"{key} = {value:g}" for key, value in row["values"].items()) or "nothing changed"
        print(f"{word} at distance {row['distance']:.3f}, from {row['start_s']:g} s: {values}")
        print("  " + (row["failed"] or f"APE {row['ape_m']:.3f} m"))
    for path in result["files"]:
        print(path)
