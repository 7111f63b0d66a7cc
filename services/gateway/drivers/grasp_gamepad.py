"""The jaws of an instrument, closed by a trigger of a gamepad, without torque."""

from __future__ import annotations

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.hands import input_events
from trocar.services.gateway.hands.steering import Axes, JawSettings, SteeredGrasp
from trocar.services.runtime.config.rig import DriverSettings

#: Left and right trigger, under any of their names; on pads without, the buttons in their place.
TRIGGERS: tuple[Axes, ...] = (
    {"ABS_Z": 1.0, "ABS_BRAKE": 1.0, "ABS_RX": 1.0, "BTN_TL2": 1.0},
    {"ABS_RZ": 1.0, "ABS_GAS": 1.0, "ABS_RY": 1.0, "BTN_TR2": 1.0},
)


class Driver(SteeredGrasp):
    """Closes as far as the trigger is pressed."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        read = driver.read_settings(JawSettings, settings, place)
        super().__init__(input_events.GAMEPAD, TRIGGERS[place.index % 2], read, place)
