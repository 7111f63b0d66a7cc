"""The bench of the driver `grasp_simulated`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench
from trocar.services.gateway.devices.clock import REAL_TIME
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Let the driver start a drive, which is then asked what it applies."""
    settings = DriverSettings(driver="grasp_simulated", device="grasp_odrive", settings={"recording": "none"})
    yield Bench(settings, output=lambda device: abs(device.applied_nm()), clock=REAL_TIME)
