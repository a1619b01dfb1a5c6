"""Write docs/sensors.md from the docstrings of sensors and samples: `python docs/scripts/make_sensors.py`."""

import ast
import dataclasses
import inspect
import re
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gymnasium import spaces

from carlaloc_env import samples
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.files.config_files import to_mapping
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.rigs.memory import EVENT_PIXEL_BYTES, PIXEL_BYTES, RAY_BYTES
from carlaloc_env.rigs.presets import RIGS
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig
from carlaloc_env.sensors.lidar_config import ReceiverConfig
from carlaloc_env.sensors.limits import LIMITS, RATE, SENSORS_MAX
from carlaloc_env.sensors.raw_gnss.config import RangeErrors, RawConfig
from carlaloc_env.sensors.registry import SENSOR_KINDS

PAGE = Path(__file__).parents[1] / "sensors.md"
HEAD = """\
# Sensors

`docs/scripts/make_sensors.py` writes this page from the docstrings; change those, not this page.

A rig is a list of the configurations below, in Python (`carlaloc_env.SensorRig`) or in YAML
([example](../examples/02_custom_rig.yaml)). Every sensor has a `name`, a [`mount`](#mount) and a `rate_hz`
that divides 200. In YAML, `preset: name` takes the values of a variant; the file's own values override them.
[Conventions](conventions.md) has frames, units and signs, [topics](topics.md) the messages, and
[LiDARs](lidars.md) those that have a name. Sources of figures are in the docstrings of the named files.

## Rigs

`paper` is the default of `gymnasium.make` and `carlaloc replay`.

"""
REAL = """
The rig `paper` has CARLA's ideal cameras, as the paper had them. For realistic images, use `real`. Its
[cameras](../carlaloc_env/rigs/industrial_camera.py) have the noise of a data sheet after EMVA 1288, a colour
filter, exposure control, motion blur and a wide-angle lens. Its LiDAR has the [receiver](#receiverconfig) of
an HDL-32E: dark and far surfaces are lost, edges mix, and lasers have errors that no calibration names. One
return in six is of the own car. Settings of systems leave out returns within 3 m.

## Surfaces

* **Reflectance varies within metres**, as a function of the world's coordinates
  ([`scene/mottle.py`](../carlaloc_env/scene/mottle.py)).
* **Beams get into foliage** by Beer and Lambert's law
  ([`raycast/foliage.py`](../carlaloc_env/raycast/foliage.py)): a point lies up to 1.2 m behind the outside
  of a crown, which a depth picture shows. All other surfaces agree.
* **Snow** is light alone in pictures; LiDARs see it by choice ([winter](winter.md)).
* **The sun** has a disc and an aureole (Buie et al. 2003), which saturate pictures that look there.
"""
PARTS = (Mount(), Pinhole(), ReceiverConfig(), RawConfig(), RangeErrors())
"""Configurations that others hold."""
COMMON = ("name", "mount")
"""Parameters of all sensors."""


def page() -> str:
    """Text of the page."""
    rigs = (f"* `{name}`: {_doc(maker)}" for name, maker in RIGS.items())
    parts = [HEAD + "\n".join(rigs), REAL, "## Kinds of sensors\n"]
    own = {kind: cls for kind, cls in SENSOR_KINDS.items() if cls.__module__.startswith("carlaloc_env.")}
    parts += [_sensor(kind, config) for kind, config in own.items()]
    parts.append("## Parts of configurations\n")
    parts += [f"### {type(part).__name__}\n\n{_doc(type(part))}\n\n{_parameters(part)}" for part in PARTS]
    parts.append(_limits())
    parts.append('## Samples\n\n`Rig.measure` and `info["samples"]` return these (`carlaloc_env.samples`).\n')
    parts += [_sample(cls) for cls in sample_classes()]
    return "\n".join(parts)


def _limits() -> str:
    """Table of all limits."""
    rows = [("every sensor", "rate_hz", RATE)]
    rows += [(kind, name, limit) for kind, table in LIMITS.items() for name, limit in table.items()]
    of: dict[str, list[str]] = {}
    for kind, name, limit in rows:
        of.setdefault(kind, []).append(f"`{name}` {limit.low:g}–{limit.high:g} {limit.unit}".rstrip())
    lines = [f"| {kind} | {', '.join(limits)} |" for kind, limits in of.items()]
    return "\n".join(
        [
            "## Limits\n",
            "Limits are checked when a rig is read, before memory is allocated. For lists, the limit is for",
            f"their length; `rays` are beams times columns. A rig has at most {SENSORS_MAX} sensors.",
            "A replay or environment does not begin if its sensors need more memory than is free: about",
            f"{PIXEL_BYTES['medium']} bytes per pixel ({PIXEL_BYTES['high']} in quality `high`), "
            f"{EVENT_PIXEL_BYTES} more with events, {RAY_BYTES} per ray.\n",
            "| sensor | from smallest to largest |",
            "|---|---|",
            *lines,
            "",
        ]
    )


def sample_classes() -> list[type[samples.Sample]]:
    """`Sample` and all kinds of samples, in the order of their modules."""
    names = [
        f"{samples.__name__}.{part}"
        for part in ("base", "images", "point_clouds", "vehicle_states", "gnss_signals", "ground_truth")
    ]
    found = [cls for _, cls in inspect.getmembers(samples, inspect.isclass)]
    mine = [cls for cls in found if issubclass(cls, samples.Sample)]
    return sorted(mine, key=lambda cls: (names.index(cls.__module__), inspect.getsourcelines(cls)[1]))


def field_docs(cls: type[Any]) -> dict[str, str]:
    """Docstring of every dataclass field, those of base classes included; empty where there is none."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for node, after in zip(body.body, [*body.body[1:], None], strict=True):
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                literal = after.value if isinstance(after, ast.Expr) else None
                text = literal.value if isinstance(literal, ast.Constant) else ""
                docs[node.target.id] = " ".join(str(text).split())
    return {field.name: docs.get(field.name, "") for field in dataclasses.fields(cls)}


def _sensor(kind: str, cls: type[SensorConfig]) -> str:
    config = cls()  # type: ignore[call-arg]  # every kind has a default name
    world: Any = SimpleNamespace(seed=0, geo=GeoReference(latitude_deg=0.0, longitude_deg=0.0))
    sensor = config.build(world)
    streams = [
        f"* `{name}`: {space.dtype}, {_shape(space, name in sensor.padded_streams)}"
        for name, space in sensor.streams().items()
        if isinstance(space, spaces.Box)
    ]
    source = f"{type(sensor).__module__.replace('.', '/')}.py"
    return "\n".join(
        [
            f"### {kind}\n\n{_doc(cls)}",
            f"\n**Method.** {_method(sensor)}\n",
            f"Source: [`{source}`](../{source}); frame `{config.frame_id}`, axes `{config.mount.axes}`; "
            f"in YAML `kind: {kind}`. It {_weather(sensor)}.\n",
            *streams,
            f"\nValues: {_doc(type(sensor).streams)}\n",
            _presets(cls),
            "**Parameters.**\n",
            _parameters(config),
        ]
    )


def _method(sensor: Any) -> str:
    """Docstrings of a sensor, and of its module where that holds no other sensor."""
    about = [] if _shares_its_module(sensor) else [_doc(inspect.getmodule(type(sensor)))]
    return "\n\n".join([*about, _doc(type(sensor))])


def _shares_its_module(sensor: Any) -> bool:
    """Whether a module holds other sensors, too, so that its docstring is not about this one alone."""
    module = inspect.getmodule(type(sensor))
    classes = inspect.getmembers(module, lambda found: inspect.isclass(found) and issubclass(found, Sensor))
    return len([name for name, found in classes if found.__module__ == type(sensor).__module__]) > 1


def _weather(sensor: Any) -> str:
    return (
        "depends on the weather" if sensor.depends_on_weather else "is the same in every weather by default"
    )


def _presets(cls: type[SensorConfig]) -> str:
    """The variants of a kind and what they change; those with a driver's layout are on the page of LiDARs."""
    if not cls.presets:
        return ""
    rows = []
    for name, values in cls.presets.items():
        if "layout" in values:
            continue
        text = ", ".join(f"`{key}` {_value(value)}" for key, value in values.items())
        rows.append(f"| `{name}` | {text or 'defaults'} |")
    return "\n".join(["**Presets.**\n", "| preset | values |", "|---|---|", *rows, ""])


def _sample(cls: type[samples.Sample]) -> str:
    common = () if cls is samples.Sample else field_docs(samples.Sample)
    rows = [f"* `{name}`: {doc}" for name, doc in field_docs(cls).items() if name not in common]
    return "\n".join([f"### {cls.__name__}\n\n{_doc(cls)}\n", *rows, ""])


def _parameters(config: Any) -> str:
    large = {
        name: value
        for name in field_docs(type(config))
        if isinstance(value := getattr(config, name), RawConfig | RangeErrors)
    }
    plain = {**to_mapping(config), **large}
    docs = field_docs(type(config)).items()
    # The first sentence: others name sources.
    rows = [
        f"* `{name}: {_value(plain[name])}`: {re.split(r'(?<=[.]) (?=[A-Z0-9])', doc)[0]}"
        if not dataclasses.is_dataclass(plain[name])
        else f"* `{name}`, {_value(plain[name])}: {doc}"
        for name, doc in docs
        if name not in COMMON
    ]
    return "\n".join([*rows, ""])


def _value(value: Any) -> str:
    if dataclasses.is_dataclass(value):
        return f"a [{type(value).__name__}](#{type(value).__name__.lower()})"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value(item)}" for key, item in value.items())
    value = list(value) if isinstance(value, tuple) else value
    if isinstance(value, list) and len(value) > 6:
        return f"{len(value)} values, {_value(value[0])} … {_value(value[-1])}"
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _shape(space: spaces.Box, padded: bool) -> str:
    return f"(N ≤ {space.shape[0]}, {space.shape[1]})" if padded else str(tuple(space.shape))


def _doc(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").strip()


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
