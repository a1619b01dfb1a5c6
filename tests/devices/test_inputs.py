"""Events of joysticks: their ids, and no display needed."""

from __future__ import annotations

import os
import subprocess
import sys

from recorder.devices.inputs import usb_of_guid


def test_usb_ids_are_read_from_guids() -> None:
    """Bytes 4–5 and 8–9 of a G29's GUID on Linux."""
    assert usb_of_guid("030000006d0400004fc2000011010000") == "046d:c24f"
    assert usb_of_guid("rubbish") == "0000:0000"


def test_no_display_is_needed() -> None:
    """Rules out that a wheel without a window opens one."""
    code = "from recorder.devices.inputs import Inputs; Inputs(window=False).pump()"
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    subprocess.run([sys.executable, "-c", code], check=True, env=env, timeout=600)
