"""The bench of the driver `force_dimension`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench
from tests.gateway.devices.dhd_library import DhdStandIn
from trocar.services.gateway.devices.clock import REAL_TIME
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """Load the stand-in of the library, which the driver's own thread calls in real time."""
    with DhdStandIn.compiled(folder) as standin:
        settings = DriverSettings(driver="force_dimension", device="omega_7", settings={"library": str(standin.path)})
        yield Bench(settings, output=lambda _: standin.force_n(), clock=REAL_TIME)
