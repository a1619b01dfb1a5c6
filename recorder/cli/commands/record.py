"""Drive and record an episode.

Examples:
  carlaloc record --map Town03 --device scripted --out drive.mcap
  carlaloc record --map Town03 --duration 40 --seed 7 --traffic 0.5 --out short.mcap
  carlaloc record --device keyboard --out mine.mcap
  carlaloc record --device wheel --calibrate
  carlaloc record --map Town03 --cars 3 --overlap 0.6 --out fleet.mcap
  carlaloc record --device policy.py --route random --start anywhere --out agent.mcap
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import ExitStack
from dataclasses import asdict
from importlib import import_module
from shutil import disk_usage
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import OutputError, UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from recorder.cli.arguments import (
    OutputFile,
    config_of,
    force_option,
    number,
    numbers,
    option,
    positive_int,
    positive_seconds,
    seed,
)
from recorder.cli.output import announced
from recorder.cli.progress import Progress
from recorder.devices.base import HUMAN, wants_window

if TYPE_CHECKING:
    from recorder.drive.record import RecordConfig
    from recorder.window.opening import Opening

BYTES_S, START_S, SPEED, FACTOR = 9e4, 20.0, 5.0, 2
"""Size of a second of a drive (70 and 100 kB in Town10 and Town03), time until the first, seconds that the
scripted driver drives in one (both assumed), and the factor within which these are meant to be right."""
_USUAL = {"map": "Town03", "weather": "ClearNoon", "traffic": "dynamic"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc record`."""
    parser.add_argument("--map", help="town, or a .xodr file (default: Town03)")
    parser.add_argument(
        "--device", help="scripted, hand, wheel, gamepad, keyboard or policy.py (default: scripted)"
    )
    parser.add_argument(
        "--choose",
        action=argparse.BooleanOptionalAction,
        help="choose device, town, weather and traffic on a start screen (default: where a person drives "
        "and neither --map, --weather nor --traffic is given)",
    )
    parser.add_argument("--out", type=OutputFile(EPISODE_SUFFIX), help="episode to write, e.g. drive.mcap")
    option(parser, "--duration", positive_seconds, "S", "length [s]; else the route")
    parser.add_argument("--seed", type=seed, default=0, help="seed of traffic and scripted driver")
    parser.add_argument(
        "--traffic", help="dynamic (default), static, empty or a fraction, with options: dynamic,walkers=0"
    )
    parser.add_argument(
        "--ride", default="standard", help="standard, or real: rolls and shakes as measured on cars"
    )
    parser.add_argument(
        "--route", nargs="+", type=route_place, default=["town"], metavar="X,Y",
        help="town (default), random, or points near lanes [m]: --route 10,20 300,-4.5",
    )  # fmt: skip
    text = "share of the route at which the car starts, 0 to below 1, or anywhere"
    option(parser, "--start", route_start, "SHARE", text, 0.0)
    option(parser, "--cars", positive_int, "N", "cars in one world (default: 1)", 1)
    text = "share of its route that each of several cars has in common with the next (default: 0.5)"
    option(parser, "--overlap", number, "SHARE", text, 0.5)
    parser.add_argument("--weather", help="weather in the window, or a schedule.yaml (default: ClearNoon)")
    parser.add_argument(
        "--window",
        action=argparse.BooleanOptionalAction,
        help="show the drive in a window (default: where a person drives)",
    )
    parser.add_argument(
        "--calibrate", action="store_true", help="ask for the device's axes, write its profile, and end"
    )
    force_option(parser, "an older episode of this name")


def route_start(text: str) -> str | float:
    """``anywhere``, or a share of the route."""
    return text if text == "anywhere" else number(text)


def route_place(text: str) -> str | tuple[float, ...]:
    """A named route, or a point [m]."""
    return numbers(text) if "," in text else text


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Record or calibrate."""
    arguments.device = arguments.device or ("keyboard" if arguments.choose else "scripted")
    if arguments.calibrate:
        return _calibrate(arguments)
    if arguments.out is None:
        raise UsageError("--out is required, e.g. --out drive.mcap")
    with ExitStack() as stack:
        opening, preferred = None, None
        is_open = _chooses(arguments)
        for name, usual in _USUAL.items():
            setattr(arguments, name, getattr(arguments, name) or usual)
        if is_open:
            preferred = _choose(arguments, stack)
        if wants_window(arguments.device, arguments.window):
            from recorder.window.opening import Opening

            # Open before the rest is loaded, which takes seconds.
            opening = stack.enter_context(Opening(arguments.map))
            opening.run("starting", lambda: import_module("recorder.drive.record"))
        return _record(arguments, opening, preferred)


def _chooses(arguments: argparse.Namespace) -> bool:
    """Whether the start screen is shown: as asked for, else where a person has left all open."""
    if arguments.choose and arguments.window is False:
        raise UsageError("--choose needs the window; leave out --no-window")
    if arguments.choose is not None:
        return bool(arguments.choose)
    is_open = not (arguments.map or arguments.weather or arguments.traffic)
    # Where SDL draws unseen, nobody could choose.
    seen = os.environ.get("SDL_VIDEODRIVER") not in ("dummy", "offscreen")
    return arguments.device in HUMAN and wants_window(arguments.device, arguments.window) and is_open and seen


def _choose(arguments: argparse.Namespace, stack: ExitStack) -> str | None:
    """Let the driver choose, in the window of the drive; the USB id of the device that steers."""
    from recorder.window.window import Window

    window = Window("CarlaLoc")
    stack.callback(window.close)
    from recorder.devices.inputs import Inputs
    from recorder.window.start_screen import DriveChoice, StartScreen

    inputs = Inputs(window=True)
    stack.callback(inputs.close)
    screen = StartScreen(window, inputs, config_of(DriveChoice, arguments))
    vars(arguments).update(asdict(screen.run()), window=True)
    preferred = screen.preferred
    inputs.close()
    return preferred


def _record(arguments: argparse.Namespace, opening: Opening | None, preferred: str | None) -> dict[str, Any]:
    from recorder.devices.registry import open_device
    from recorder.drive.record import RecordConfig, record

    route = arguments.route
    config = config_of(
        RecordConfig, arguments, overwrite=arguments.force,
        route=route[0] if route[1:] == [] and isinstance(route[0], str) else tuple(route),
    )  # fmt: skip
    _announce(config)
    with Progress("recording") as progress:

        def report(driven_s: float, route_m: float) -> None:
            progress.update(driven_s, arguments.duration, f"{route_m:.0f} m")

        # `record` opens the device by its name alone.
        chosen = preferred and open_device(config.device, config.seed, window=True, preferred=preferred)
        result = record(config, device=chosen or None, progress=report, opening=opening)
    files = {"attempts": [str(p) for p in result.attempts], "photos": [str(p) for p in result.photos]}
    return {**asdict(result), "path": str(result.path), **files}


def _announce(config: RecordConfig) -> None:
    """Write size and time of a drive before it begins, and refuse one that the disk cannot hold."""
    from recorder.drive.standard_drives import expected_drive_s

    long_s = config.duration_s or expected_drive_s(config.map)
    size = long_s * BYTES_S
    free = disk_usage(next(path for path in config.out.absolute().parents if path.exists())).free
    if size > FACTOR * free:
        raise OutputError(
            f"{long_s:.0f} s of driving need about {size / 1e6:.0f} MB (within a factor of {FACTOR}), and "
            f"{free / 1e6:.0f} MB are free for {config.out}; make room, or choose another --out"
        )
    time_s = long_s if config.wants_window else START_S + long_s / SPEED
    announced(
        f"about {size / 1e6:.0f} MB and {time_s:.0f} s for {long_s:.0f} s of driving (a factor of {FACTOR}); "
        "the first drive in a town takes a minute more"
    )


def _calibrate(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.devices.calibrate import calibrate

    path = calibrate(arguments.device, ask=lambda line: print(line, file=sys.stderr))
    return {"profile": str(path)}


def show(result: dict[str, Any]) -> None:
    """Print what was recorded."""
    # Here and not above: a window opens before this is loaded.
    from recorder.drive.pacer import SLOW

    if "profile" in result:
        print(f"calibrated; the profile is {result['profile']}")
    else:
        print(
            f"{result['path']}: {result['duration_s']:.1f} s, {result['driven_m']:.1f} m driven, "
            f"{result['route_m']:.1f} m along the route, {result['collisions']} collisions"
        )
        for number, car in enumerate(result["cars"], 1):
            print(f"  car {number}: {car['driven_m']:.1f} m driven, {car['collisions']} collisions")
        for kind, count in result["violations"].items():
            print(f"  {kind.replace('_', ' ')}: {count}")
        for path in result["attempts"]:
            print(f"  an attempt given up is in {path}")
        for path in result["photos"]:
            print(f"  photo: {path}")
        if result["passed_mps"] is not None:
            print(f"  the end of the route was passed at {3.6 * result['passed_mps']:.0f} km/h")
        if result["stuck"]:
            print("  the car made no progress for five minutes; try another --seed or a longer --duration")
        if result["slowest"] < SLOW:
            print(f"  this machine was slow: the world ran at {result['slowest']:.0%} at times")
