"""A library that calls at another rate than it was told, and one that for ten frames knows no number."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.hdapi.hdapi_bench import FREE, LEFT, RATE_N_S, RIGHT, HdapiBench, two_arms
from trocar.services.gateway.servo import servo_arrays


@pytest.fixture
def arms(tmp_path: Path) -> Iterator[HdapiBench]:
    with two_arms(tmp_path) as bench:
        yield bench


class Calling:
    """Lets the library call so often a second while the gateway exchanges once a millisecond."""

    def __init__(self, bench: HdapiBench, hz: int) -> None:
        assert hz in (500, 1000, 2000)
        self.bench, self.hz = bench, hz
        self.forces: list[np.ndarray] = []  # of the left arm, after every call
        self.ms = 0
        if hz == 2000:
            bench.c.standin_period_us(500)

    def millisecond(self) -> None:
        """Let a millisecond pass."""
        bench = self.bench
        self.ms += 1
        if self.hz == 2000:
            bench.c.standin_tick(ctypes.c_int64(bench.standin.clock.monotonic_ns() + 500_000))
            self.forces.append(bench.applied(1))
        if self.hz == 500 and self.ms % 2:
            bench.c.standin_stall(1)
        bench.standin.clock.sleep(1e-3)
        self.forces.append(bench.applied(1))

    def exchange(self, force: tuple[float, float, float] = FREE, stiffness_n_m: float = 0.0) -> None:
        """Read the left arm and order, as the gateway does, then let the library call."""
        self.bench.left.read(0, self.bench.readings[self.bench.left])
        self.bench.order(self.bench.left, np.array(force), stiffness_n_m)
        self.millisecond()


@pytest.mark.parametrize("hz", [500, 1000, 2000])
def test_velocity_is_that_of_the_hand_at_the_rate_at_which_the_library_calls(arms: HdapiBench, hz: int) -> None:
    """A quarter of a second was taken for the rate that was asked for: at 2 kHz half of the velocity was read."""
    arms.open()
    calling = Calling(arms, hz)
    for k in range(900):
        arms.standin.put("hand", 1, np.array([0.0, 1e-4 * k, 0.0]))  # 0.1 m/s upward
        calling.exchange()
        if k > 800:
            assert arms.readings[arms.left][servo_arrays.READ_VELOCITY + 2] == pytest.approx(0.1, rel=0.06)
    assert arms.left.gauges()["servo_rate_hz"] == pytest.approx(hz, rel=0.02)


@pytest.mark.parametrize("hz", [500, 2000])
def test_at_any_rate_force_is_finite_moves_by_its_rate_and_gives_no_energy(arms: HdapiBench, hz: int) -> None:
    arms.bound()
    arms.open()
    calling = Calling(arms, hz)
    for _ in range(600):
        calling.exchange()
    calling.forces.clear()
    taken_j = 0.0
    for k in range(2000):
        arms.standin.put("hand", 1, np.array([0.0, -0.006 * np.sin(4 * np.pi * 1e-3 * k) ** 2, 0.0]))
        before = arms.standin.look(1)
        calling.exchange(stiffness_n_m=400.0)
        way_m = arms.standin.look(1).position_m - before.position_m
        taken_j += float(before.force_n @ way_m)
    forces = np.array(calling.forces)
    assert np.isfinite(forces).all()
    assert np.abs(forces).max() > 0.5, "the wall is there"
    rises = np.diff(np.linalg.norm(forces, axis=1))
    assert rises.max() <= RATE_N_S * max(1e-3, 1.0 / hz) + 1e-9
    assert taken_j < 1e-4 + 0.04 * 0.006 * 8, "no more than the arm's friction takes"


@pytest.mark.parametrize("hz", [500, 1000, 2000])
def test_a_filter_is_that_of_the_rate(arms: HdapiBench, hz: int) -> None:
    """A step of velocity has gone through after the same time, not after as many calls."""
    arms.open()
    calling = Calling(arms, hz)
    for _ in range(700):
        calling.exchange()
    arms.standin.put("hand", 1, np.array([0.0, 0.0, 0.0]))
    seen = []
    for k in range(40):
        arms.standin.put("place", 1, np.array([0.0, 1e-4 * k, 0.0]))
        calling.exchange()
        seen.append(arms.readings[arms.left][servo_arrays.READ_VELOCITY + 2])
    assert np.max(seen[12:]) == pytest.approx(0.1, rel=0.5)
    assert seen[-1] == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("what", [1, 2, 3], ids=["position", "angles and temperature", "all"])
def test_a_pose_that_is_no_number_for_ten_frames_is_survived_with_finite_forces(arms: HdapiBench, what: int) -> None:
    arms.open()
    arms.begin(LEFT, RIGHT)
    arms.forces.clear()
    arms.c.standin_not_a_number(1, what)
    arms.run(10, LEFT, RIGHT)
    arms.c.standin_not_a_number(1, 0)
    readings = arms.readings[arms.left]
    assert readings[servo_arrays.READ_ROLL] == pytest.approx(-0.25)
    assert np.isfinite(readings).all()
    assert arms.left.fault == "", "ten frames are no fault"
    arms.run(150, FREE, RIGHT)
    arms.run(150, LEFT, RIGHT)
    assert np.isfinite(arms.forces).all()
    assert arms.largest_step_n() <= RATE_N_S * 1e-3 + 1e-12
    np.testing.assert_allclose(arms.forces[-1], [LEFT, RIGHT], atol=1e-9)
    assert np.isfinite(readings).all()
    assert arms.left.arm is not None
    assert np.isfinite(arms.left.arm.port.newest).all()


@pytest.mark.parametrize("later", [0, 1, 2])
def test_two_arms_that_draw_back_together_get_what_one_put_in_once(arms: HdapiBench, later: int) -> None:
    """Each knows of the other by way of the gateway, frames late: they got 2 mJ more before that was reserved."""
    arms.bound()
    arms.open()
    for opened in (arms.left.arm, arms.right.arm):
        assert opened is not None
        opened.cell.delay_s = 0.0  # motors of the stand-in act at once: so the books are of what was done
    for _ in range(500):
        _together(arms, (0.0, 0.0), 0.0)
    for k in range(400):
        _together(arms, (-25e-3 * min(1.0, k / 300), 0.0), 0.0, 600.0)
    places_m = np.array([-25e-3, 0.0])
    for k in range(60):
        _together(arms, places_m, 6.0)
        places_m += 1.2e-3 * np.clip(0.3 * np.array([k, k - later]), 0.0, 1.0)
    left_j, right_j = (memory[servo_arrays.MEMORY_ENERGY] for memory in arms.memories.values())
    assert min(left_j, right_j) < -0.02, "one pays for the other"
    assert left_j + right_j > -0.1e-3


def _together(arms: HdapiBench, hands_m: Sequence[float], force_n: float, stiffness_n_m: float = 0.0) -> None:
    """Exchange with both arms, then move their hands upward to these places in a frame."""
    for driver, reading in arms.readings.items():
        driver.read(arms.standin.clock.monotonic_ns(), reading)
    for driver in arms.readings:
        arms.order(driver, np.array([0.0, 0.0, force_n]), stiffness_n_m)
    for device, place_m in zip((1, 2), hands_m, strict=True):
        arms.standin.put("hand", device, np.array([0.0, place_m, 0.0]))
    arms.wait(1)
