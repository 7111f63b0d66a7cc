"""The jaws of an instrument, closed while a button of a SpaceMouse is held, without torque."""

from __future__ import annotations

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.hands import input_events
from trocar.services.gateway.hands.steering import JawSettings, SteeredGrasp
from trocar.services.runtime.config.rig import DriverSettings


class Driver(SteeredGrasp):
    """Closes while the left button is held, and opens when it is released."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        read = driver.read_settings(JawSettings, settings, place)
        super().__init__(input_events.SPACEMOUSE, {"BTN_0": 1.0}, read, place)
