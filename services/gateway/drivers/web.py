"""An instrument in the hand of a person at the page: mouse, keyboard, gamepad or touch. Force is shown, not felt."""

from __future__ import annotations

import numpy as np

from protocol.bodies import Hands, HandTarget
from services.gateway import driver
from services.gateway.driver import Place
from services.gateway.hand_arm import HandArm, HandSettings
from services.runtime.rig import DriverSettings

TOPIC = "visualization.hands"


class Driver(HandArm):
    """Follows `visualization.hands`; stays where it is when nobody speaks."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        super().__init__("web", driver.read_settings(HandSettings, settings, place), place)
        self._begins = 0

    def begin_again(self) -> None:
        """Put the tool where it waits, whatever a page says that does not know of it yet."""
        super().begin_again()
        self._begins += 1

    def follow(self, _time_ns: int, _passed_s: float) -> None:
        """Take what the page says."""
        hand = hand_of(self.place, self._begins)
        if hand is not None:
            self.target = np.array(hand.position_m)
            self.target_roll = hand.roll_rad


def hand_of(place: Place, begins: int) -> HandTarget | None:
    """Return where the page wants the instrument that is here, None if it does not say.

    ``begins`` is how often the scene was begun again: what a page says that knows of less is let be.
    """
    frame = place.newest(TOPIC)
    if frame is None or not frame.valid:
        return None
    body: Hands = frame.body
    hands = body.hands if body.begins == begins else ()
    return next((hand for hand in hands if hand.name == place.instrument), None)
