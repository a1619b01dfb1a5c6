"""List the names that commands take: weathers, traffic levels, rigs, formats, topics, methods, devices.

Examples:
  carlaloc list weathers
  carlaloc list formats --json
  carlaloc list rigs lidar --yaml
"""

import argparse
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError, unknown_name

KINDS = ("weathers", "traffic", "rigs", "formats", "topics", "methods", "devices")
"""Kinds of names."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc list`."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("name", nargs="?", help="one name of them, or a .yaml file of a rig to check")
    parser.add_argument("--yaml", action="store_true", help="print a rig as the YAML file of --rig")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Collect the names."""
    from recorder.listed_names import list_names

    names, name = list_names(arguments.kind), arguments.name
    if arguments.kind == "rigs" and name is not None and name.endswith((".yaml", ".yml")):
        from carlaloc_env.rigs.presets import rig_by_name

        names[name] = f"a file: {', '.join(sensor.name for sensor in rig_by_name(name).sensors)}"
    if arguments.yaml and (arguments.kind != "rigs" or name is None):
        raise UsageError("--yaml prints one rig: carlaloc list rigs lidar --yaml")
    if name is not None:
        if name not in names:
            raise ConfigError(unknown_name(arguments.kind.removesuffix("s"), name, names))
        names = {name: names[name]}
    listed = {"kind": arguments.kind, "names": names}
    if arguments.yaml:
        from carlaloc_env.rigs.presets import rig_by_name

        listed["yaml"] = rig_by_name(name).to_yaml()
    return listed


def show(result: dict[str, Any]) -> None:
    """Print a line for each name, or a rig."""
    if "yaml" in result:
        print(result["yaml"], end="")
        return
    width = max(len(name) for name in result["names"])
    for name, what in result["names"].items():
        print(f"{name:<{width}}  {what}".rstrip())
