"""The jaws of an instrument, closed while a button of a SpaceMouse is held. No torque is felt."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.gateway import driver, input_events, input_stand_in
from services.gateway.bench import Bench, no_output
from services.gateway.driver import Place
from services.gateway.steering import JawSettings, SteeredGrasp
from services.runtime.rig import DriverSettings


class Driver(SteeredGrasp):
    """Closes while the left button is held, and opens when it is let go."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        read = driver.read_settings(JawSettings, settings, place)
        super().__init__(input_events.SPACEMOUSE, {"BTN_0": 1.0}, read, place)


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """A cap that nobody touches."""
    with input_events.stand_in(input_stand_in.spacemouse()):
        yield Bench(DriverSettings(driver="grasp_spacemouse"), output=no_output)
