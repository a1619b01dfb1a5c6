"""Names that options take, each with a few words on it: weathers, traffic levels, rigs, formats and so on."""

from collections.abc import Callable

from carlaloc_env.core.errors import ConfigError, unknown_name


def list_names(kind: str) -> dict[str, str]:
    """Names of a kind, and a few words on each.

    Args:
        kind: `weathers`, `traffic`, `rigs`, `formats`, `topics`, `methods` or `devices`.

    Raises:
        ConfigError: there is no such kind.
    """
    if kind not in LISTS:
        raise ConfigError(unknown_name("kind", kind, LISTS))
    return LISTS[kind]()


def _weathers() -> dict[str, str]:
    from carlaloc_env.weather.presets import PRESETS

    return {
        name: f"sun {w.sun_altitude_angle:g}° high, clouds {w.cloudiness:g} %, rain {w.precipitation:g} %, "
        f"fog {w.fog_density:g} %, wetness {w.wetness:g} %"
        + (f", snow {w.snowfall:g} mm/h on {100 * w.snow_cover:g} % of the ground" if w.snow_cover else "")
        for name, w in PRESETS.items()
    }


def _traffic() -> dict[str, str]:
    from recorder.episode.traffic_level import LEVEL_WORDS

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
    from recorder.writers.topic_profiles import PROFILES

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


LISTS: dict[str, Callable[[], dict[str, str]]] = {
    "weathers": _weathers,
    "traffic": _traffic,
    "rigs": _rigs,
    "formats": _formats,
    "topics": _topics,
    "methods": _methods,
    "devices": _devices,
}
"""Lists by name, and the function that collects each: names, and a few words on each."""
