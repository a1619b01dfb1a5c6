"""List the names that commands take: weathers, traffic levels, rigs, formats, topics, methods, devices.

Examples:
  carlaloc list weathers
  carlaloc list formats --json
  carlaloc list rigs lidar --yaml
  carlaloc list rigs my.yaml --out my_rig.png
"""

import argparse
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError, unknown_name
from recorder.cli.arguments import OutputFile, force_option, option

KINDS = ("weathers", "traffic", "rigs", "formats", "topics", "methods", "devices")
"""Kinds of names."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc list`."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("name", nargs="?", help="one name of them, or a .yaml file of a rig to check")
    parser.add_argument("--yaml", action="store_true", help="print a rig as the YAML file of --rig")
    option(parser, "--out", OutputFile(".png"), "PNG", "draw where a rig's sensors sit on the car")
    force_option(parser, "an older picture")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Collect the names."""
    from recorder.listed_names import list_names

    names, name = list_names(arguments.kind), arguments.name
    if arguments.kind == "rigs" and name is not None and name.endswith((".yaml", ".yml")):
        from carlaloc_env.rigs.presets import rig_by_name

        names[name] = f"a file: {', '.join(sensor.name for sensor in rig_by_name(name).sensors)}"
    if (arguments.yaml or arguments.out) and (arguments.kind != "rigs" or name is None):
        what = "--yaml prints" if arguments.yaml else "--out draws"
        raise UsageError(f"{what} one rig: carlaloc list rigs lidar {what.split()[0]} …")
    if name is not None:
        if name not in names:
            raise ConfigError(unknown_name(arguments.kind.removesuffix("s"), name, names))
        names = {name: names[name]}
    listed = {"kind": arguments.kind, "names": names}
    if arguments.kind == "rigs" and name is not None:
        listed |= _one_rig(name, arguments)
    return listed


def _one_rig(name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Places of a rig's sensors and notes on them; its file and its picture where they are asked for."""
    from carlaloc_env.rigs.notes import rig_notes
    from carlaloc_env.rigs.presets import rig_by_name

    rig = rig_by_name(name)
    sensors = [
        {"kind": s.kind, "name": s.name, "position_m": s.mount.position_m, "rate_hz": s.rate_hz}
        for s in rig.sensors
    ]
    found: dict[str, Any] = {"sensors": sensors, "notes": rig_notes(rig)}
    if arguments.yaml:
        found["yaml"] = rig.to_yaml()
    if arguments.out:
        from recorder.report.rig_plot import plot_rig

        found["picture"] = str(plot_rig(rig, arguments.out, overwrite=arguments.force))
    return found


def show(result: dict[str, Any]) -> None:
    """Print a line for each name, or a rig."""
    if "yaml" in result:
        print(result["yaml"], end="")
        return
    width = max(len(name) for name in result["names"])
    for name, what in result["names"].items():
        print(f"{name:<{width}}  {what}".rstrip())
    for sensor in result.get("sensors", ()):
        forward, left, up = sensor["position_m"]
        place = f"{forward:6.2f} {left:6.2f} {up:6.2f} m"
        print(f"  {sensor['kind']:7} {sensor['name']:14} {place}  {sensor['rate_hz']:g} Hz")
    for note in result.get("notes", ()):
        print(f"note: {note}")
    if "picture" in result:
        print(result["picture"])
