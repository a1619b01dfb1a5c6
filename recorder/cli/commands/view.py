"""Look at an episode, a sequence or a town in rerun's viewer, or write a recording (.rrd) or a page of it.

Examples:
  carlaloc view drive.mcap
  carlaloc view data/Town03/ClearNoon_dynamic --estimate kiss.tum --out look.rrd
  carlaloc view --html data/Town03/ClearNoon_dynamic --out scene.html
  carlaloc view Town03
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from recorder.cli.arguments import OutputFile, force_option, input_path, option, positive_seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc view`."""
    parser.add_argument("what", type=input_path, help="episode (.mcap), folder of a sequence, or town")
    parser.add_argument("--map", type=input_path, help="map of an episode that was driven on a file")
    parser.add_argument(
        "--estimate", type=input_path, action="append", metavar="TUM", help="estimate of a sequence; repeat"
    )
    parser.add_argument(
        "--frame",
        choices=("lidar", "imu", "camera", "base_link"),
        default="lidar",
        help="whose poses estimates are",
    )
    option(parser, "--period", positive_seconds, "S", "between clouds (default: 0.2)", 0.2)
    parser.add_argument(
        "--html", action="store_true", help="write one page that any browser opens, offline; needs --out"
    )
    parser.add_argument(
        "--out", type=OutputFile(".rrd", ".html"), help="write a recording or page and open no viewer"
    )
    force_option(parser, "an older file")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write a recording or page, and show the recording if it has no name."""
    if arguments.html != (arguments.out is not None and arguments.out.suffix.lower() == ".html"):
        raise UsageError("--html and a page after --out go together; give both: --html --out scene.html")
    if arguments.html:
        kind = _record(arguments, arguments.out)
        return {"kind": kind, "out": str(arguments.out), "bytes": arguments.out.stat().st_size, "html": True}
    from recorder.view.recording import check_display, open_viewer

    if arguments.out is not None:
        kind = _record(arguments, arguments.out)
        return {"kind": kind, "out": str(arguments.out), "bytes": arguments.out.stat().st_size}
    check_display()
    with tempfile.TemporaryDirectory(prefix="carlaloc-view-") as folder:
        path = Path(folder, "view.rrd")
        kind = _record(arguments, path)
        open_viewer(path)
    return {"kind": kind, "out": None}


def _record(arguments: argparse.Namespace, out: Path) -> str:
    """Write the recording or page and return its kind."""
    from recorder.dataset.layout import SEQUENCE, is_sequence

    what: Path = arguments.what
    is_episode = what.suffix == EPISODE_SUFFIX or what.name.endswith(".recording")
    if arguments.estimate and not is_sequence(what):
        raise UsageError("--estimate is for sequences; give the folder of one")
    if is_episode:
        return _episode(arguments, out)
    if is_sequence(what):
        return _sequence(arguments, out)
    if what.is_dir() and not (what / "town.xodr").is_file():
        raise ConfigError(f"{what} is no sequence and no town; give a folder that holds {SEQUENCE}")
    from carlaloc_env.town.build import load_town

    if arguments.html:
        from recorder.view.scene_page import page_of_town

        page_of_town(load_town(what), out, overwrite=arguments.force)
        return "town"
    from recorder.view.recording import record_town

    record_town(load_town(what), out, overwrite=arguments.force)
    return "town"


def _episode(arguments: argparse.Namespace, out: Path) -> str:
    from recorder.episode.episode import open_episode
    from recorder.episode.summary import town_of

    episode = open_episode(arguments.what)
    town = town_of(episode, arguments.map)
    if arguments.html:
        from recorder.view.scene_page import page_of_episode

        page_of_episode(episode, town, out, overwrite=arguments.force)
    else:
        from recorder.view.recording import record_episode

        record_episode(episode, town, out, overwrite=arguments.force)
    return "episode"


def _sequence(arguments: argparse.Namespace, out: Path) -> str:
    from recorder.dataset.layout import sequence_at
    from recorder.dataset.sequence import SlamSequence
    from recorder.dataset.trajectories import read_trajectory
    from recorder.evaluation.associate import Association
    from recorder.evaluation.evaluate import PathErrors, evaluate
    from recorder.evaluation.trajectory_files import read_tum

    sequence = SlamSequence(sequence_at(arguments.what).path)
    estimates = []
    if arguments.estimate:
        truth = read_tum(sequence.truth_file(arguments.frame))
        estimates = [
            PathErrors.of(evaluate(truth, read_trajectory(path), association=Association.INTERPOLATED))
            for path in arguments.estimate
        ]
    settings = {"estimates": estimates, "period_s": arguments.period, "overwrite": arguments.force}
    if arguments.html:
        from recorder.view.scene_page import page_of_sequence

        page_of_sequence(sequence, out, **settings)
    else:
        from recorder.view.sequence_view import record_sequence

        record_sequence(sequence, out, **settings)
    return "sequence"


def show(result: dict[str, Any]) -> None:
    """Print what was written."""
    if result["out"] is not None:
        how = "open it in a browser" if result.get("html") else "rerun FILE shows it"
        print(f"{result['out']}  {result['kind']}, {result['bytes'] / 1e6:.1f} MB; {how}")
