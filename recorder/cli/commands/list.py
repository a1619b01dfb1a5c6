"""List the names that commands take: weathers, traffic levels, rigs, formats, topics, methods, devices.

Examples:
  carlaloc list weathers
  carlaloc list formats --json
  carlaloc list rigs lidar --yaml
"""

import argparse
from collections.abc import Callable
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError, unknown_name


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc list`."""
    parser.add_argument("kind", choices=tuple(KINDS), metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("name", nargs="?", help="one name of them")
    parser.add_argument("--yaml", action="store_true", help="print a rig as the YAML file of --rig")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Collect the names."""
    names, name = KINDS[arguments.kind](), arguments.name
    if arguments.yaml and (arguments.kind != "rigs" or name is None):
        raise UsageError("--yaml prints one rig: carlaloc list rigs lidar --yaml")
    if name is not None:
        if name not in names:
            raise ConfigError(unknown_name(arguments.kind.removesuffix("s"), name, names))
        names = {name: names[name]}
    found = {"kind": arguments.kind, "names": names}
    if arguments.yaml:
        from carlaloc_env.rigs.presets import rig_by_name

        found["yaml"] = rig_by_name(name).to_yaml()
    return found


def show(result: dict[str, Any]) -> None:
    """Print a line for each name, or a rig."""
    if "yaml" in result:
        print(result["yaml"], end="")
        return
    width = max(len(name) for name in result["names"])
    for name, what in result["names"].items():
        print(f"{name:<{width}}  {what}".rstrip())


def _weathers() -> dict[str, str]:
    from carlaloc_env.weather.parameters import PRESETS

    return {
        name: f"sun {w.sun_altitude_angle:g}° high, clouds {w.cloudiness:g} %, rain {w.precipitation:g} %, "
        f"fog {w.fog_density:g} %, wetness {w.wetness:g} %"
        for name, w in PRESETS.items()
    }


def _traffic() -> dict[str, str]:
    from recorder.episode.summary import LEVEL_WORDS

    return dict(LEVEL_WORDS)


def _rigs() -> dict[str, str]:
    from carlaloc_env.rigs.presets import RIG_USES, RIGS

    return {
        name: f"{RIG_USES[name]}: "
        + ", ".join(s.name if s.kind == s.name else f"{s.kind} {s.name}" for s in make().sensors)
        for name, make in RIGS.items()
    }


def _formats() -> dict[str, str]:
    from recorder.dataset.layout import FORMATS

    return {name: form.about for name, form in FORMATS.items()}


def _topics() -> dict[str, str]:
    from recorder.writers.topics import PROFILES

    return {
        name: f"{len({rule.topic for rule in profile.rules})} topics" for name, profile in PROFILES.items()
    }


def _methods() -> dict[str, str]:
    from recorder.slam.systems import SYSTEMS

    return {name: s.what + (f"; {s.missing}" if s.missing else "") for name, s in SYSTEMS.items()}


def _devices() -> dict[str, str]:
    from recorder.devices.base import DEVICES

    return dict.fromkeys(DEVICES, "") | {
        "scripted": "drives the town's route by itself",
        "hand": "the same driver on a virtual wheel and its pedals",
        "wheel": "wheel and pedals, by profile or calibrated",
        "gamepad": "gamepad",
        "keyboard": "arrow keys in the window",
    }


KINDS: dict[str, Callable[[], dict[str, str]]] = {
    "weathers": _weathers,
    "traffic": _traffic,
    "rigs": _rigs,
    "formats": _formats,
    "topics": _topics,
    "methods": _methods,
    "devices": _devices,
}
"""Lists by name, and the function that collects each: names, and a few words on each."""
