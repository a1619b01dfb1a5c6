"""Durations and sizes as people read them."""

from __future__ import annotations


def duration_text(seconds: float) -> str:
    """A duration in the two units that matter, such as ``8 h 20 min``, ``12 min`` or ``45 s``."""
    whole = max(round(seconds), 0)
    if whole < 90:
        return f"{whole} s"
    minutes = max(round(seconds / 60), 0)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def size_text(size: float) -> str:
    """An amount of data in decimal units, such as ``310 GB``, ``4.2 GB`` or ``35 MB``."""
    for unit, factor in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if size >= 0.9995 * factor:
            value = size / factor
            return f"{value:.1f} {unit}" if value < 9.95 else f"{value:.0f} {unit}"
    return f"{max(round(size / 1e3), 0)} kB"
