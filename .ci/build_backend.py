"""Setuptools' build backend, which first says in one line what PyBullet lacks on this Python.

Without that, pip would load a gigabyte and end in the pages of a compiler that is not there.
`-C pybullet=unchecked` builds a wheel for another machine nevertheless.
"""

from __future__ import annotations

import pybullet_check
from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403

Settings = dict[str, str | list[str] | None] | None


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """What a build needs besides setuptools; the first hook that pip calls."""
    _check(config_settings)
    return build_meta.get_requires_for_build_wheel(config_settings)


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """The same for `pip install --editable`."""
    _check(config_settings)
    return build_meta.get_requires_for_build_editable(config_settings)


def _check(config_settings: Settings) -> None:
    line = "" if (config_settings or {}).get("pybullet") == "unchecked" else pybullet_check.refusal()
    if line:
        raise SystemExit(line)
