"""The bench of the driver `haply`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench
from tests.gateway.devices.haply_service import HaplyService
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Let a service of one arm stand in, whose time passes when the driver's does."""
    service = HaplyService()
    settings = DriverSettings(driver="haply", device="inverse3", settings={"port": service.port})
    try:
        yield Bench(settings, output=lambda _: service.force_n("049D"), clock=service.clock)
    finally:
        service.close()
