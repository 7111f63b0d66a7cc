"""The bench of the driver `grasp_force_dimension`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gateway.devices.bench import Bench
from tests.gateway.devices.dhd_library import DhdStandIn
from trocar.services.gateway.devices.clock import REAL_TIME
from trocar.services.gateway.devices.device_files import GripperFile
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """Load the stand-in of the library, which the driver's own thread calls in real time."""
    lever_m = config.load(GripperFile, config.find("device", "grasp_omega_7"))[0].lever_m
    with DhdStandIn.compiled(folder) as standin:
        settings = DriverSettings(
            driver="grasp_force_dimension", device="grasp_omega_7", settings={"library": str(standin.path)}
        )
        yield Bench(settings, output=lambda _: abs(standin.grip_n()) * lever_m, clock=REAL_TIME)
