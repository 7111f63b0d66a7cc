"""An instrument controlled at the page by mouse, keyboard, gamepad or touch. Force is displayed, not applied."""

from __future__ import annotations

import numpy as np

from trocar.protocol.bodies import Hands, HandTarget
from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.hands.hand_arm import HandArm, HandSettings
from trocar.services.runtime.config.rig import DriverSettings

TOPIC = "visualization.hands"


class Driver(HandArm):
    """Follows `visualization.hands`, and keeps its position without messages."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        super().__init__("web", driver.read_settings(HandSettings, settings, place), place)
        self._begins = 0

    def begin_again(self) -> None:
        """Reset the tool to its start, and ignore pages that do not know of the restart yet."""
        super().begin_again()
        self._begins += 1

    def move_target(self, _time_ns: int, _passed_s: float) -> None:
        """Set the target from the page."""
        hand = hand_of(self.place, self._begins)
        if hand is not None:
            self.target = np.array(hand.position_m)
            self.target_roll = hand.roll_rad


def hand_of(place: Place, begins: int) -> HandTarget | None:
    """Return the page's target for this instrument, None without one.

    ``begins`` is the number of restarts of the scene; targets of pages that know of fewer are ignored.
    """
    frame = place.newest(TOPIC)
    if frame is None or not frame.valid:
        return None
    body: Hands = frame.body
    hands = body.hands if body.begins == begins else ()
    return next((hand for hand in hands if hand.name == place.instrument), None)
