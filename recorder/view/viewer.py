"""Opens rerun's viewer on a recording."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from carlaloc_env.core.errors import DeviceError


def check_display() -> None:
    """Make sure that a window can be opened.

    Raises:
        DeviceError: there is no display.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DeviceError(
            "there is no display for rerun's viewer; write a recording with --out FILE.rrd and open that "
            "elsewhere with: rerun FILE.rrd"
        )


def open_viewer(recording: Path) -> None:
    """Show a recording until the viewer is closed.

    It listens to this machine alone, not to all of the network, which is its own default.

    Raises:
        DeviceError: the viewer ended with an error.
    """
    words = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--new", str(recording)]
    status = subprocess.run(words, check=False).returncode
    if status:
        raise DeviceError(f"rerun's viewer ended with exit status {status}; its messages are above")
