"""The jaws of an instrument in the hand of a person at the page. No torque is felt."""

from __future__ import annotations

from services.gateway import driver
from services.gateway.driver import Place
from services.gateway.drivers.web import hand_of
from services.gateway.hand_grasp import HandGrasp, HandGraspSettings
from services.runtime.rig import DriverSettings


class Driver(HandGrasp):
    """Follows the opening in `visualization.hands`."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        super().__init__(driver.read_settings(HandGraspSettings, settings, place), place)
        self._begins = 0

    def begin_again(self) -> None:
        """Be as nobody had taken it, whatever a page says that does not know of it yet."""
        super().begin_again()
        self._begins += 1

    def opening(self, _time_ns: int) -> float | None:
        """Return what the page says; a negative opening is none."""
        hand = hand_of(self.place, self._begins)
        return hand.opening if hand is not None and hand.opening >= 0.0 else None
