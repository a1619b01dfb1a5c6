"""Replay an episode under any weather and traffic, and write datasets.

Examples:
  carlaloc replay drive.mcap --out data --weather ClearNoon,FoggyNoon --traffic static,dynamic
  carlaloc replay fleet.mcap --out fleet --car all --rig lidar --format rosbag2
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
    number,
    option,
    positive_int,
    positive_seconds,
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
    parser.add_argument(
        "--car", type=car_number, metavar="N",
        help="of a drive of several cars, the one that carries the rig, or all: in OUT/car<N> (default: the "
        "first, in OUT)",
    )  # fmt: skip
    parser.add_argument(
        "--roadside", action="append", default=[], metavar="X,Y,Z,YAW[,RIG]",
        help="a fixed unit beside the cars, in OUT/roadside<N>: place in the world [m], direction [deg] and "
        "rig (default: --rig); may be repeated; without --car, of all cars",
    )  # fmt: skip
    text = "besides, one bag of all cars in OUT/all_cars, with topics below /car1, /car2, …"
    parser.add_argument("--one-bag", action="store_true", help=text)
    option(parser, "--radio-range", number, "M", "cars hear each other so far [m], with --car all", 70.0)
    parser.add_argument("--map", help="map of the drive, where the episode names none that is known")


def car_number(text: str) -> str | int:
    """``all``, or the number of a car."""
    return text if text == "all" else positive_int(text)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Replay."""
    from carlaloc_env.faults.faults import Faults
    from carlaloc_env.rigs.notes import rig_notes
    from recorder.episode.episode import Episode
    from recorder.replaying.cost import size_of
    from recorder.replaying.options import ReplayConfig, rig_of, snow_notes
    from recorder.replaying.replay import replay
    from recorder.replaying.start_at_rest import motion_at_start_of
    from recorder.replaying.together import check_one_bag, write_together

    faults = Faults.parse(arguments.fault)
    config = config_of(ReplayConfig, arguments, faults=faults, car=1, roadside=None)
    car = "all" if arguments.roadside and arguments.car is None else arguments.car
    carried = [*_of_cars(config, car), *_of_units(config, arguments.roadside)]
    if arguments.one_bag:
        check_one_bag(carried)
    results: dict[ReplayConfig, Any] = {}
    known: list[ReplayCost] = []
    replays = [seeded for one in carried for seeded in _of_noise_seeds(one, arguments.noise_seeds)]

    def announce(cost: ReplayCost) -> None:
        """Before the first replay, for all of them."""
        count = len(replays)
        cost = replace(cost, written_bytes=count * cost.written_bytes, cpu_s=count * cost.cpu_s)
        cost.check(config.out, kept_bytes=size_of(config.out))
        announced(cost)
        if not known:
            for note in (*rig_notes(rig_of(config)), *snow_notes(config)):
                announced(f"note: {note}")
            if start := motion_at_start_of(Episode.load(config.episode).timeline(), config.start_s):
                announced(f"the stretch {start}")
        known.append(cost)

    for replayed in replays:
        with Progress("replaying") as progress:
            announcing = None if results else announce
            results[replayed] = replay(replayed, progress.update, announce=announcing)
    between = _between_cars(config, carried, arguments) if car == "all" else {}
    together = write_together(config.out, carried, results, one_bag=arguments.one_bag)
    samples: Counter[str] = Counter()
    for result in results.values():
        samples.update(result.samples)
    return {
        "out": str(arguments.out),
        "sequences": [str(path) for result in results.values() for path in result.sequences],
        **({"together": [str(path) for path in together]} if together else {}),
        "ground_truth": str(next(iter(results.values())).ground_truth),
        "samples": dict(sorted(samples.items())),
        **between,
    }


def _of_cars(config: ReplayConfig, car: str | int | None) -> list[ReplayConfig]:
    """The replay of the first car, or of one or all in folders of their own."""
    if car is None:
        return [config]
    from recorder.episode.episode import open_episode

    cars = range(1, len(open_episode(config.episode).egos) + 1) if car == "all" else [int(car)]
    return [replace(config, car=number, out=config.out / f"car{number}") for number in cars]


def _of_units(config: ReplayConfig, texts: list[str]) -> list[ReplayConfig]:
    """The replay of each fixed unit, in a folder of its own."""
    from recorder.replaying.options import rig_of
    from recorder.replaying.roadside import parse_roadside

    parsed = [parse_roadside(text, number) for number, text in enumerate(texts, 1)]
    units = [
        replace(config, roadside=unit, rig=rig or config.rig, out=config.out / unit.name)
        for unit, rig in parsed
    ]
    for one in units:
        rig_of(one)
    return units


def _between_cars(
    config: ReplayConfig, carried: list[ReplayConfig], arguments: argparse.Namespace
) -> dict[str, Any]:
    """Write the truth between cars and units, where there are several."""
    if len(carried) < 2:
        return {}
    from recorder.laboratory.between_cars import write_between_cars
    from recorder.replaying.plan import plan_replay

    plans = [plan_replay(one) for one in carried]
    with Progress("pairs of cars") as progress:
        written = write_between_cars(
            plans, config.out, radio_range_m=arguments.radio_range, report=progress.update
        )
    return {"between_cars": str(written.folder), "closures": written.closures}


def _of_noise_seeds(config: ReplayConfig, count: int) -> list[ReplayConfig]:
    """The replay, or as many that differ in the seed of sensor noise alone, in folders of their own."""
    if count == 1:
        return [config]
    first = config.first_seed(config.episode)
    return [replace(config, seed=first + k, out=config.out / f"seed{first + k}") for k in range(count)]


def show(result: dict[str, Any]) -> None:
    """Print what was written."""
    for path in (*result["sequences"], *result.get("together", ())):
        print(path)
    if "between_cars" in result:
        closures = "" if result["closures"] is None else f"  ({result['closures']} closures)"
        print(f"{result['between_cars']}{closures}")
    print(f"{result['ground_truth']}  ({sum(result['samples'].values())} samples in all)")
