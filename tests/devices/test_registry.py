"""Devices by name."""

import pytest

from carlaloc_env.core.errors import DeviceError
from recorder.devices.registry import open_device


def test_devices_by_name() -> None:
    device = open_device("scripted", 1)
    assert device.name == "scripted"
    device.close()
    device.close()
    with pytest.raises(DeviceError, match="did you mean 'scripted'"):
        open_device("skripted", 1)
