"""The bench of the driver `grasp_spacemouse`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench, no_output
from tests.gateway.hands import input_stand_in
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """A cap that nobody touches."""
    with input_stand_in.only(input_stand_in.spacemouse()):
        yield Bench(DriverSettings(driver="grasp_spacemouse"), output=no_output)
