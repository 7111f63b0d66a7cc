"""An instrument steered with a SpaceMouse. Force is displayed, not applied."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.hands import input_events
from trocar.services.gateway.hands.steering import Axes, SteeredArm, SteeringSettings, check_inputs
from trocar.services.runtime.config.rig import DriverSettings

#: The cap's own axes are x to the right, y to the user, z down. Kernels report them as relative or as absolute axes.
CAP: dict[str, Axes] = {
    "right": {"REL_X": 1.0, "ABS_X": 1.0},
    "up": {"REL_Z": -1.0, "ABS_Z": -1.0},
    "inward": {"REL_Y": -1.0, "ABS_Y": -1.0},
    "roll": {"REL_RZ": 1.0, "ABS_RZ": 1.0},
}


class Driver(SteeredArm):
    """Pushing the cap moves the tool the same way: away from the person is in; turning it rolls the tool."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        read = driver.read_settings(SteeringSettings, settings, place)
        super().__init__("spacemouse", input_events.SPACEMOUSE, CAP, read, place)


def check_host(_settings: Sequence[DriverSettings], _in_use: bool) -> Iterator[HostCheck]:
    """Check for a SpaceMouse."""
    yield check_inputs(input_events.SPACEMOUSE)
