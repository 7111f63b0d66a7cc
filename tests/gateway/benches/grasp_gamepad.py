"""The bench of the driver `grasp_gamepad`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench, no_output
from tests.gateway.hands import input_stand_in
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """A gamepad that nobody touches."""
    with input_stand_in.only(input_stand_in.gamepad()):
        yield Bench(DriverSettings(driver="grasp_gamepad"), output=no_output)
