"""Drivers of Haply's arms on a stand-in of the service, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from tests.gateway.devices.haply_service import HaplyService
from tests.gateway.kicks import kicks_n
from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.limited_force import SPARE_S
from trocar.services.gateway.drivers.haply import Driver
from trocar.services.gateway.servo import servo_arrays
from trocar.services.runtime.config.rig import DriverSettings, Mount

RATE_N_S = 200.0
PUSH = np.array([0.5, -0.3, 1.0])
#: A step at the rate limit in a tick that a late one precedes.
STEP_N = RATE_N_S * (TICK_S + SPARE_S) + 1e-9


class HaplyBench:
    """Arms of a service in the drivers' hands."""

    def __init__(self, service: HaplyService, *settings: dict[str, Any], device: str = "inverse3") -> None:
        self.service, self.device = service, device
        self.drivers = [self.driver(own) for own in settings or ({},)]
        self.readings = [np.full(servo_arrays.READ_SIZE, np.nan) for _ in self.drivers]
        self.places: list[np.ndarray] = []  # of the first arm

    def driver(self, own: dict[str, Any]) -> Driver:
        settings = {"port": self.service.port, **own}
        place = Place("left", Mount(), clock=self.service.clock, force_rate_n_s=RATE_N_S)
        return Driver(DriverSettings(driver="haply", device=self.device, settings=settings), place)

    def open(self) -> None:
        for driver in self.drivers:
            driver.open()
            driver.enable()

    def run(self, ticks: int, *forces: np.ndarray) -> None:
        """Exchange as the gateway does; arms for which no force is named get `PUSH`."""
        for _ in range(ticks):
            for driver, reading in zip(self.drivers, self.readings, strict=True):
                driver.read(self.service.clock.monotonic_ns(), reading)
            for k, driver in enumerate(self.drivers):
                driver.write(forces[k] if k < len(forces) else PUSH)
            self.places.append(self.readings[0][:3].copy())
            self.service.clock.sleep(TICK_S)

    def applied(self, name: str) -> np.ndarray:
        """Return the force on the hand in the frame of the arm."""
        x, y, z = self.service.arms[name].force_n
        return np.array([-y, x, z])

    def largest_step_n(self) -> float:
        """Return the largest rise or turn of a force from tick to tick."""
        return float(kicks_n(np.array(self.service.forces)).max())

    def largest_move_m(self) -> float:
        """Return how far the first arm's tool has moved in a tick at most."""
        return float(np.linalg.norm(np.diff(self.places, axis=0), axis=1).max())


@contextmanager
def arms(*settings: dict[str, Any], device: str = "inverse3", **kinds: str) -> Iterator[HaplyBench]:
    """Put arms on the bench, not open yet."""
    service = HaplyService(**kinds)
    bench = HaplyBench(service, *settings, device=device)
    try:
        yield bench
    finally:
        service.held_back = False
        for driver in bench.drivers:
            driver.close()
        service.close()
