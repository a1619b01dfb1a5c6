"""Lets the scripted driver turn a virtual wheel and pedals, through the same code as a person's.

Controls go through SDL, its 16-bit axes, the device's profile and filters, once per image, as a person's do.
"""

from dataclasses import replace
from itertools import count

from carlaloc_env.core.ego import Controls
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.physics.params import VehicleParams
from recorder.devices.axis_shape import AxisShape
from recorder.devices.control_shaping import wheel_steer
from recorder.devices.human import HumanDevice
from recorder.devices.inputs import Inputs
from recorder.devices.profile import DeviceProfile
from recorder.devices.scripted.driver import ScriptedDriver
from recorder.devices.virtual_stick import VirtualStick

IMAGE_HZ = 30
"""Images that a drive by hand lasts a second [Hz]: devices are read once in each."""
_PEDAL = AxisShape(axis=2, rest=1.0, full=-1.0)
PROFILE = DeviceProfile(
    name="scripted hand",
    kind="wheel",
    usb=("1209:0001",),
    steer=AxisShape(axis=0, rest=0.0, full=-1.0, opposite=1.0, dead_zone=0.0, saturation=0.0),
    throttle=_PEDAL,
    brake=replace(_PEDAL, axis=3),
    buttons={"handbrake": 0},
)
"""The virtual wheel, with the axes and dead zones of usual ones."""


class ScriptedHand(HumanDevice):
    """Turns a virtual wheel and presses its pedals as the scripted driver wants it.

    The drive counts images and not seconds, so that a slow machine does not change it.

    Args:
        inputs: Where events come from.
        seed: Seed of the driver.
    """

    def __init__(self, inputs: Inputs, seed: int) -> None:
        vendor, product = (int(half, 16) for half in PROFILE.usb[0].split(":"))
        self._stick = VirtualStick(name=PROFILE.name, usb=(vendor, product))
        # As anybody who sits down: the wheel turned a little, both pedals pressed and let go.
        for steer, pedal in ((0.1, -1.0), (0.0, 1.0)):
            for axis, value in ((0, steer), (2, pedal), (3, pedal)):
                self._stick.axis(axis, value)
            inputs.pump()
        super().__init__("wheel", inputs, [PROFILE])
        self._scripted, self._images = ScriptedDriver(seed), count()
        self._turned_per_steer = 0.1 / wheel_steer(0.1, PROFILE.rotation_deg, VehicleParams())

    def clock(self) -> float:
        """Time of the drive, an image later at each call [s]."""
        return next(self._images) / IMAGE_HZ

    def read(self, view: DriverView) -> Controls:
        """Controls for the coming tick, from where wheel and pedals were at the last image."""
        wanted = self._scripted.read(view)
        self._stick.axis(0, -wanted.steer * self._turned_per_steer)
        for axis, value in ((2, wanted.throttle), (3, wanted.brake)):
            # A foot that is used to these pedals steps over their dead zone.
            travel = _PEDAL.dead_zone + value * (1.0 - _PEDAL.dead_zone - _PEDAL.saturation)
            self._stick.axis(axis, 1.0 - 2.0 * travel * (value > 0.0))
        self._stick.button(PROFILE.buttons["handbrake"], wanted.handbrake)
        return super().read(view)

    def close(self) -> None:
        """Pull the wheel out, and let the other devices go; may be called twice."""
        self._stick.unplug()
        super().close()
