"""Text files that users give: read as UTF-8, or refused in one line."""

from __future__ import annotations

from pathlib import Path

from carlaloc_env.core.errors import CarlaLocError, ConfigError


def read_text(path: Path, kind: str, error: type[CarlaLocError] = ConfigError) -> str:
    """Text of a file, without the mark that editors of Windows put at the beginning.

    Args:
        path: The file.
        kind: What it should be, e.g. ``"rig"``.
        error: Kind of the error raised.

    Raises:
        CarlaLocError: of this kind; the file cannot be read or is no text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as fault:
        where = f"at byte {fault.start + 1}"
        raise error(
            f"cannot read the {kind} {path}: no UTF-8 text {where}; save it as UTF-8, or give another file"
        ) from fault
    except OSError as fault:
        raise error(f"cannot read the {kind} {path}: {fault.strerror or fault}; give another file") from fault
