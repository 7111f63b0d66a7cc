"""The bench of the driver `grasp_web`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench, no_output
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Nobody is at the page: the handle waits."""
    yield Bench(DriverSettings(driver="grasp_web"), output=no_output)
