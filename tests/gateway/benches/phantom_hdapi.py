"""The bench of the driver `phantom_hdapi`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench
from tests.gateway.hdapi.hdapi_library import HdapiStandIn
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """Load the stand-in of the library, whose time passes when the driver's does."""
    with HdapiStandIn.compiled(folder) as standin:
        settings = DriverSettings(
            driver="phantom_hdapi", device="phantom_premium_1_5", settings={"library": str(standin.path)}
        )
        yield Bench(settings, output=lambda _: standin.force_n(0), clock=standin.clock)
