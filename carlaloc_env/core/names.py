"""Names that become parts of file names, topics and frames."""

from __future__ import annotations

import re

from carlaloc_env.core.errors import ConfigError

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
