"""The jaws of an instrument controlled at the page, without torque."""

from __future__ import annotations

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.drivers.web import hand_of
from trocar.services.gateway.hands.hand_grasp import HandGrasp, HandGraspSettings
from trocar.services.runtime.config.rig import DriverSettings


class Driver(HandGrasp):
    """Follows the opening in `visualization.hands`."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        super().__init__(driver.read_settings(HandGraspSettings, settings, place), place)
        self._begins = 0

    def begin_again(self) -> None:
        """Reset to the initial opening, and ignore pages that do not know of the restart yet."""
        super().begin_again()
        self._begins += 1

    def opening(self, _time_ns: int) -> float | None:
        """Return the opening from the page; a negative one is none."""
        hand = hand_of(self.place, self._begins)
        return hand.opening if hand is not None and hand.opening >= 0.0 else None
