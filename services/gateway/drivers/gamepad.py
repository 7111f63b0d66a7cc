"""An instrument steered with one half of a gamepad, which rumbles with the force on the tool."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.hands import input_events
from trocar.services.gateway.hands.steering import Axes, SteeredArm, SteeringSettings, check_inputs
from trocar.services.runtime.config.rig import DriverSettings

#: Names are those of the kernel's gamepad layout. The first instrument has the left half, the second the right one.
#: The right stick is on RX and RY or on Z and RZ, where other pads have their triggers.
HALVES: tuple[dict[str, Axes], ...] = (
    {"right": {"ABS_X": 1.0}, "up": {"ABS_Y": -1.0}, "inward": {"ABS_HAT0Y": -1.0}, "roll": {"ABS_HAT0X": 1.0}},
    {
        "right": {"ABS_RX": 1.0, "ABS_Z": 1.0},
        "up": {"ABS_RY": -1.0, "ABS_RZ": -1.0},
        "inward": {"BTN_SOUTH": 1.0, "BTN_EAST": -1.0},
        "roll": {"BTN_TR": 1.0, "BTN_TL": -1.0},
    },
)


class Driver(SteeredArm):
    """The stick moves the tool sideways and up, the pad's other keys along and about its shaft."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        read = driver.read_settings(SteeringSettings, settings, place)
        super().__init__("gamepad", input_events.GAMEPAD, HALVES[place.index % 2], read, place)


def check_host(_settings: Sequence[DriverSettings], _in_use: bool) -> Iterator[HostCheck]:
    """Look for a gamepad."""
    yield check_inputs(input_events.GAMEPAD)
