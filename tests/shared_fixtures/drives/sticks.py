"""A route for devices that hardly look at it, and sticks that SDL makes in software."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest
from shared_fixtures.drives.driver_runs import route_of

from carlaloc_env.core.errors import DeviceError
from carlaloc_env.map.routing.route import Route
from recorder.devices.inputs import Inputs
from recorder.devices.virtual_stick import VirtualStick


class _Plugged(VirtualStick):
    """A stick of a test, which is skipped where SDL makes none."""

    def __init__(self, *args: Any, **options: Any) -> None:
        try:
            super().__init__(*args, **options)
        except DeviceError as error:
            pytest.skip(str(error))


@pytest.fixture
def plug() -> type[VirtualStick]:
    """Makes virtual sticks."""
    return _Plugged


@pytest.fixture
def straight_route() -> Route:
    """A kilometre eastwards at 50 km/h."""
    return route_of([(1000.0, 0.0)], 13.9)


@pytest.fixture
def inputs() -> Iterator[Inputs]:
    """Events of all sticks, without a window."""
    pytest.importorskip("pygame")
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    source = Inputs(window=False)
    yield source
    source.close()
