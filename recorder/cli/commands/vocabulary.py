"""Train a vocabulary of image features for ORB-SLAM3 on a dataset's own images.

Examples:
  carlaloc vocabulary data --out orb.txt
  CARLALOC_ORBSLAM3_VOCABULARY=orb.txt carlaloc benchmark data --methods orbslam3_stereo
"""

import argparse
from typing import Any

from recorder.cli.arguments import OutputFile, force_option, input_path, option, positive_int
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc vocabulary`."""
    parser.add_argument("data", type=input_path, help="folder with sequences that have mav0")
    parser.add_argument("--out", type=OutputFile(".txt"), required=True, help="text file in DBoW2's format")
    option(parser, "--images", positive_int, "N", "images at most (default: 150)", 150)
    force_option(parser, "an older vocabulary")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Train it."""
    from recorder.slam.orb_vocabulary import write_vocabulary

    with Progress("reading", unit="images") as progress:
        words = write_vocabulary(
            arguments.data, arguments.out, images=arguments.images, progress=progress.update
        )
    return {"out": str(arguments.out), "words": words}


def show(result: dict[str, Any]) -> None:
    """Print how many words it has."""
    print(f"{result['out']}  {result['words']} words")
