"""The line of a log that says why a program has ended."""

from __future__ import annotations

from pathlib import Path

_ERROR_LINE = 300
"""Longest text of an error that is kept [characters]."""


def last_line(log: Path, *, but: str = "") -> str:
    """Last line that a system printed and that an error, `but`, does not hold already; empty: none."""
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    printed = [line.strip()[:_ERROR_LINE] for line in lines if line.strip()]
    return next((line for line in reversed(printed) if line not in but), "")
