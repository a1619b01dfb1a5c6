"""Text that users give in files, and the last line of a log, which states why a program has ended."""

from pathlib import Path

from carlaloc_env.core.errors import CarlaLocError, ConfigError

_ERROR_LINE = 300
"""Longest text of an error that is kept [characters]."""


def read_text(path: str | Path, kind: str, error: type[CarlaLocError] = ConfigError) -> str:
    """Text of a file, without the mark that editors of Windows put at the beginning.

    Args:
        path: The file.
        kind: What it should be, e.g. ``"rig"``.
        error: Kind of the error raised.

    Raises:
        CarlaLocError: of this kind; the file cannot be read or is no text.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as fault:
        where = f"at byte {fault.start + 1}"
        raise error(
            f"cannot read the {kind} {path}: no UTF-8 text {where}; save it as UTF-8, or give another file"
        ) from fault
    except OSError as fault:
        raise error(f"cannot read the {kind} {path}: {fault.strerror or fault}; give another file") from fault


def last_line(log: Path, *, but: str = "") -> str:
    """Last line that a system printed and that an error, `but`, does not hold already; empty: none."""
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    printed = [line.strip()[:_ERROR_LINE] for line in lines if line.strip()]
    return next((line for line in reversed(printed) if line not in but), "")
