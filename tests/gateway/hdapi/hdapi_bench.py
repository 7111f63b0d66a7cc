"""Arms of the stand-in library in the driver's hands, tick by tick."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from tests.gateway.hdapi.hdapi_library import HdapiStandIn
from tests.gateway.kicks import ENDLESS_N, kicks_n
from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_CONTACT, MODEL_F0, MODEL_K
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.drivers.phantom_hdapi import Driver
from trocar.services.gateway.servo import servo_arrays
from trocar.services.runtime.config.rig import DriverSettings, Mount

RATE_N_S = 200.0
TTL_MS = 20
TTL_S = 1e-3 * TTL_MS
FREE = (0.0, 0.0, 0.0)
LEFT, RIGHT = (0.3, -0.2, 2.0), (0.0, 1.0, 0.0)
#: A step at the rate limit, and what rounding adds.
STEP_N = RATE_N_S * 1e-3 + 1e-12
#: Coulomb friction of an arm in whose law energy is bounded.
DRY_N = 0.04


class HdapiBench:
    """Drivers `left` and `right` on devices 1 and 2 of a stand-in, and what their devices did in every tick.

    What they are told is a force, or with `by_law` a model whose force it is.
    """

    def __init__(self, standin: HdapiStandIn, device: str = "touch") -> None:
        self.by_law = False
        self.bounded = False  # whether a force gives no more than was put in
        self.standin = standin
        self.c = standin.c
        self.device = device
        self.left, self.right = self.driver("left"), self.driver("right")
        self.readings = {driver: np.zeros(servo_arrays.READ_SIZE) for driver in (self.left, self.right)}
        self.memories = {driver: np.zeros(servo_arrays.MEMORY_SIZE) for driver in self.readings}
        self.forces: list[np.ndarray] = []  # of both arms, (2, 3), in the frame of the arms

    def driver(self, side: str, mount: Mount = Mount()) -> Driver:  # noqa: B008 - never changes
        name, library = side.capitalize(), str(self.standin.path)
        settings = DriverSettings(
            driver="phantom_hdapi", device=self.device, settings={"name": name, "library": library}
        )
        return Driver(settings, Place(side, mount, clock=self.standin.clock, force_rate_n_s=RATE_N_S))

    def open(self, enabled: bool = True) -> None:
        for driver in self.readings:
            driver.open()
            if enabled:
                driver.enable()

    def close(self) -> None:
        for driver in self.readings:
            driver.close()

    def run(self, ticks: int, left: tuple[float, float, float], right: tuple[float, float, float]) -> None:
        """Exchange as the gateway does, for so many ticks."""
        orders = {self.left: np.array(left), self.right: np.array(right)}
        for _ in range(ticks):
            for driver, reading in self.readings.items():
                driver.read(self.standin.clock.monotonic_ns(), reading)
            for driver, force in orders.items():
                self.order(driver, force)
            self.wait(1)

    def begin(self, left: tuple[float, float, float], right: tuple[float, float, float]) -> None:
        """Ask for nothing until arms are calibrated and trusted, then for forces: they cannot begin otherwise."""
        self.run(400, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self.run(50, left, right)

    def bound(self) -> None:
        """Let the force be by law, and give no more than was put in; the arms have the friction that the law needs."""
        self.by_law = self.bounded = True
        for device in (1, 2):
            self.c.standin_dry(device, ctypes.c_double(DRY_N))

    def taken_in_a_tick_j(self) -> float:
        """Wait for the left arm's next tick; return the work of its force past the arm's friction in it, in J."""
        before = self.standin.look(1)
        self.wait(1)
        way_m = self.standin.look(1).position_m - before.position_m
        return float(before.force_n @ way_m) - DRY_N * float(np.linalg.norm(way_m))

    def order(self, driver: Driver, force: np.ndarray, stiffness_n_m: float = 0.0, ttl_s: float = TTL_S) -> None:
        """Tell an arm what to do in this tick."""
        if not self.by_law:
            driver.write(force)
            return
        model, limits, now = np.zeros(MODEL_COLUMNS), np.zeros(servo_arrays.LIMIT_SIZE), np.zeros(servo_arrays.NOW_SIZE)
        model[MODEL_F0 : MODEL_F0 + 3] = force
        model[[MODEL_K, MODEL_K + 4, MODEL_K + 8]] = stiffness_n_m
        model[MODEL_CONTACT] = 1.0
        limits[servo_arrays.LIMIT_FORCE] = limits[servo_arrays.LIMIT_CONTINUOUS_FORCE] = 20.0
        limits[servo_arrays.LIMIT_RATE] = RATE_N_S
        limits[servo_arrays.LIMIT_ARM + servo_arrays.OWN_COUNT] = driver.limits.count_m
        limits[servo_arrays.LIMIT_ARM + servo_arrays.OWN_FRICTION] = DRY_N if self.bounded else ENDLESS_N
        now[servo_arrays.NOW_TTL], now[servo_arrays.NOW_GAIN] = ttl_s, 1.0
        for memory in (memory for other, memory in self.memories.items() if other is not driver):
            now[servo_arrays.NOW_OTHERS] += memory[servo_arrays.MEMORY_ENERGY]
            now[servo_arrays.NOW_RESERVED] += memory[servo_arrays.MEMORY_RESERVED]
        driver.evaluate(model, np.zeros(6), limits, now, self.memories[driver])

    def wait(self, ticks: int) -> None:
        """Let time pass without a word of the gateway."""
        for _ in range(ticks):
            self.standin.clock.sleep(1e-3)
            self.forces.append(np.array([self.applied(1), self.applied(2)]))

    def applied(self, device: int) -> np.ndarray:
        """Return the force on the hand in the frame of the arm."""
        return self.standin.look(device).force_n[[2, 0, 1]]

    def force_n(self, device: int) -> float:
        """Return the magnitude of the force on the hand."""
        return self.standin.force_n(device)

    def largest_step_n(self) -> float:
        """Return the largest rise or turn of a force from tick to tick."""
        return float(kicks_n(np.array(self.forces)).max())


@contextmanager
def two_arms(folder: Path, device: str = "touch") -> Iterator[HdapiBench]:
    with ExitStack() as stack:
        bench = HdapiBench(stack.enter_context(HdapiStandIn.compiled(folder)), device)
        stack.callback(bench.close)
        yield bench
