"""The bench of the driver `grasp_spacemouse`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway import input_stand_in
from tests.gateway.bench import Bench, no_output
from trocar.services.runtime.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """A cap that nobody touches."""
    with input_stand_in.only(input_stand_in.spacemouse()):
        yield Bench(DriverSettings(driver="grasp_spacemouse"), output=no_output)
