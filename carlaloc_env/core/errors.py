"""Named errors: one line each, saying what is wrong and what to do next.

Names that become parts of file names, topics and frames.
"""

import difflib
import re
from collections.abc import Iterable

LENGTH_MAX = 600
"""Longest message [characters]; what a damaged file holds may be longer."""


class CarlaLocError(Exception):
    """Base of all errors that a user can cause or cure; its message is one printable line."""

    def __init__(self, message: object) -> None:
        # Gymnasium's vectors make an error anew of the error itself.
        super().__init__(_one_line(str(message)))


class ConfigError(CarlaLocError):
    """A configuration value, key or name is not valid."""


class UsageError(ConfigError):
    """Options of a command do not fit together."""


class MapError(CarlaLocError):
    """An OpenDRIVE file or town folder cannot be used."""


class EpisodeError(CarlaLocError):
    """An episode file cannot be read or written."""


class RenderError(CarlaLocError):
    """Pictures cannot be made on this machine."""


class RaycastError(CarlaLocError):
    """Rays cannot be cast on this machine."""


class ActionError(CarlaLocError):
    """An action is not finite or out of its range."""


class ClosedError(CarlaLocError):
    """Something is used after it has been closed."""


class DeviceError(CarlaLocError):
    """An input device is missing or gave no usable value."""


class WriterError(CarlaLocError):
    """A dataset cannot be written."""


class OutputError(CarlaLocError):
    """A file or folder may not be written there: it exists, or its name is that of another kind."""


class EvaluationError(CarlaLocError):
    """Trajectories cannot be compared."""


class MissingDependencyError(CarlaLocError):
    """An optional library is not installed; the message holds the install line."""


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> str:
    """One line for an unknown name: the nearest valid one first, then all of them.

    Args:
        kind: What the name stands for, e.g. ``"town"``.
        name: What the user typed.
        valid: All valid names.
    """
    names = sorted(valid)
    lowered = {n.lower(): n for n in names}
    near = difflib.get_close_matches(name.lower(), list(lowered), n=1, cutoff=0.5)
    hint = f"; did you mean '{lowered[near[0]]}'?" if near else "."
    return f"no {kind} '{name}'{hint} Known: {', '.join(names)}"


def _one_line(text: str) -> str:
    """The text without line breaks and control characters, cut in the middle where it is too long."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    half = LENGTH_MAX // 2 - 2
    return line if len(line) <= LENGTH_MAX else f"{line[:half]} … {line[-half:]}"


_NAME = re.compile(r"[A-Za-z0-9_.-]{1,100}")


def is_name(text: str) -> bool:
    """Whether a text may name a sensor, frame, town or sequence: letters, digits, ``_``, ``.`` and ``-``."""
    return bool(_NAME.fullmatch(text)) and text not in (".", "..")


def check_name(what: str, text: str) -> str:
    """The text, if it is a name; what comes from files of others must not lead to other folders.

    Args:
        what: What it names, for the message, such as ``"sensor"``.
        text: What a file or a user says.

    Raises:
        ConfigError: it holds other characters, or is empty, too long, ``.`` or ``..``.
    """
    if not is_name(text):
        raise ConfigError(
            f"{what} {text[:120]!r}: names have 1 to 100 letters, digits, '_', '.' or '-'; rename it"
        )
    return text
