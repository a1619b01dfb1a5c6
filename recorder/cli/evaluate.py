"""Compare estimated trajectories with the truth: APE and RPE.

Examples:
  carlaloc evaluate --truth data/Town03/ground_truth/lidar.tum estimate.tum
  carlaloc evaluate --truth truth.tum orb.tum vins.tum --align posyaw --plot figures
"""

from __future__ import annotations

import argparse
from typing import Any

from carlaloc_env.core.errors import ConfigError, unknown_name
from recorder.cli.arguments import OutputFolder, force_option, input_path

PLOT = "trajectories.png"
"""Name of the picture."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc evaluate`."""
    parser.add_argument("--truth", type=input_path, required=True, help="true trajectory (TUM)")
    parser.add_argument("estimates", type=input_path, nargs="+", metavar="EST", help="estimates (TUM)")
    parser.add_argument("--align", default="se3", help="se3, sim3, posyaw or none (default: se3)")
    parser.add_argument("--plot", type=OutputFolder(PLOT), metavar="DIR", help=f"draw {PLOT} there")
    force_option(parser, "an older picture")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Evaluate."""
    from recorder.evaluation.align import Alignment
    from recorder.evaluation.evaluate import evaluate
    from recorder.evaluation.trajectory import read_tum

    known = {alignment.name.lower(): alignment for alignment in Alignment}
    if arguments.align not in known:
        raise ConfigError(unknown_name("alignment", arguments.align, known))
    truth = read_tum(arguments.truth)
    results = [
        evaluate(truth, read_tum(path), alignment=known[arguments.align]) for path in arguments.estimates
    ]
    plots: list[str] = []
    if arguments.plot is not None:
        from recorder.report.trajectory_plot import plot_trajectories

        picture = plot_trajectories(results, arguments.plot / PLOT, overwrite=arguments.force)
        plots = [str(picture)]
    return {"results": [result.to_mapping() for result in results], "plots": plots}


def show(result: dict[str, Any]) -> None:
    """Print a table."""
    for row in result["results"]:
        print(f"{row['estimate']}  against {row['truth']}")
        print(f"  {row['matched']} of {row['expected']} poses ({row['coverage']:.1%}); {row['alignment']}")
        for metric in row["metrics"].values():
            print(
                f"  {metric['label']:<58} rmse {metric['rmse']:.4f}  mean {metric['mean']:.4f}  "
                f"max {metric['max']:.4f} {metric['unit']}"
            )
    for plot in result["plots"]:
        print(plot)
