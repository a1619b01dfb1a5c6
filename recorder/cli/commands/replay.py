"""Replay an episode under any weather and traffic, and write datasets.

Examples:
  carlaloc replay drive.mcap --out data --weather ClearNoon,FoggyNoon --traffic static,dynamic
  carlaloc replay drive.mcap --out lidar --rig lidar --format rosbag1 --start 10 --duration 20
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from recorder.cli.arguments import (
    add_replay_options,
    add_stretch_options,
    config_of,
    input_path,
    option,
    positive_int,
    positive_seconds,
    replay_options,
    seconds,
)
from recorder.cli.output import announced
from recorder.cli.progress import Progress

if TYPE_CHECKING:
    from recorder.replaying.cost import ReplayCost
    from recorder.replaying.options import ReplayConfig


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc replay`."""
    parser.add_argument("episode", type=input_path, help="episode to replay (.mcap)")
    add_replay_options(parser, weathers=("ClearNoon",), traffic=("dynamic",))
    add_stretch_options(parser)
    option(parser, "--camera-start", seconds, "S", "pictures begin here [s]")
    option(parser, "--camera-duration", positive_seconds, "S", "length of pictures [s]")
    text = "as many datasets, of this and the next seeds of noise, in OUT/seed<S>"
    option(parser, "--noise-seeds", positive_int, "N", text, 1)
    parser.add_argument("--map", help="map of the drive, where the episode names none that is known")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Replay."""
    from carlaloc_env.rigs.notes import rig_notes
    from recorder.episode.episode import Episode
    from recorder.replaying.cost import size_of
    from recorder.replaying.options import ReplayConfig, rig_of, snow_notes
    from recorder.replaying.replay import replay
    from recorder.replaying.start_at_rest import motion_at_start_of

    config = config_of(
        ReplayConfig, arguments, **replay_options(arguments), start_s=arguments.start,
        duration_s=arguments.duration, camera_start_s=arguments.camera_start,
        camera_duration_s=arguments.camera_duration,
    )  # fmt: skip
    results: list[Any] = []
    known: list[ReplayCost] = []
    replays = _of_noise_seeds(config, arguments.noise_seeds)

    def announce(cost: ReplayCost) -> None:
        """Before the first replay, for all of them."""
        count = len(replays)
        cost = replace(cost, written_bytes=count * cost.written_bytes, cpu_s=count * cost.cpu_s)
        cost.check(config.out, kept_bytes=size_of(config.out))
        announced(cost)
        if not known:
            for note in (*rig_notes(rig_of(config)), *snow_notes(config)):
                announced(f"note: {note}")
        if not known and (
            note := motion_at_start_of(Episode.load(config.episode).timeline(), config.start_s)
        ):
            announced(f"the stretch {note}")
        known.append(cost)

    for replayed in replays:
        with Progress("replaying") as progress:
            results.append(replay(replayed, progress.update, announce=None if results else announce))
    samples: Counter[str] = Counter()
    for result in results:
        samples.update(result.samples)
    return {
        "out": str(arguments.out),
        "sequences": [str(path) for result in results for path in result.sequences],
        "ground_truth": str(results[0].ground_truth),
        "samples": dict(sorted(samples.items())),
    }


def _of_noise_seeds(config: ReplayConfig, count: int) -> list[ReplayConfig]:
    """The replay, or as many that differ in the seed of sensor noise alone, in folders of their own."""
    if count == 1:
        return [config]
    from recorder.episode.episode import open_episode

    first = config.seed
    if first is None:
        first = open_episode(config.episode).header.seed
    return [replace(config, seed=first + k, out=config.out / f"seed{first + k}") for k in range(count)]


def show(result: dict[str, Any]) -> None:
    """Print what was written."""
    for path in result["sequences"]:
        print(path)
    print(f"{result['ground_truth']}  ({sum(result['samples'].values())} samples in all)")
