"""Input devices by name."""

import logging
import os
from pathlib import Path

from recorder.devices.base import HUMAN, POLICY_SUFFIX, Device, check_device, wants_window
from recorder.devices.human import HumanDevice
from recorder.devices.inputs import Inputs
from recorder.devices.policy import PolicyDriver
from recorder.devices.profile import known_profiles
from recorder.devices.scripted.driver import ScriptedDriver
from recorder.devices.scripted.hand import ScriptedHand

_LOG = logging.getLogger(__name__)


def open_device(name: str, seed: int, *, window: bool = False, preferred: str | None = None) -> Device:
    """Device of a name.

    Args:
        name: Its name, e.g. ``scripted``, or a ``.py`` file that drives.
        seed: Seed for devices that are driven by the program.
        window: Whether a window shows the drive; no person drives without.
        preferred: USB id of the wheel or pad that steers, where several could.

    Raises:
        DeviceError: there is no such device, or it is not connected.
        ConfigError: a profile of the user's is not valid.
        MissingDependencyError: pygame is not installed.
    """
    check_device(name)
    if name.endswith(POLICY_SUFFIX):
        return PolicyDriver(Path(name))
    if name == "scripted":
        return ScriptedDriver(seed)
    wants_window(name, window)
    if name in HUMAN and os.environ.get("SDL_VIDEODRIVER") in ("dummy", "offscreen"):
        _LOG.warning(
            "SDL_VIDEODRIVER=%s: the window is invisible and gets no keys; unset it to drive by hand",
            os.environ["SDL_VIDEODRIVER"],
        )
    inputs = Inputs(window=window)
    try:
        if name == "hand":
            return ScriptedHand(inputs, seed)
        return HumanDevice(name, inputs, known_profiles(), preferred=preferred)
    except Exception:
        inputs.close()
        raise
