"""What a machine must give for an attempt to count, and what is said where it does not."""

from __future__ import annotations

import importlib

import pytest

from trocar.protocol import bodies
from trocar.services.gateway.drivers import known_drivers
from trocar.services.runtime.config.config import load_rig
from trocar.services.runtime.config.rig import FORCELESS
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.fitness import LEAST_PICTURES_HZ, Fitness

LATE = bodies.SupervisorState(state="degraded", reason="physics: 70 ticks lost in the last minute, budget 60")


def seen(fitness: Fitness, pictures_hz: float, speed: float = 1.0, seconds: float = 4.0) -> str:
    for k in range(round(10 * seconds)):
        fitness.take_tick(0.1 * k, round(100 * k * speed), 1.0)
        fitness.take_pictures(0.1 * k, pictures_hz)
    return fitness.practice_only


def test_without_force_a_late_loop_does_not_matter_and_a_slow_picture_does() -> None:
    fitness = Fitness(simulated=True)
    fitness.take_rig(LATE, frozenset())
    assert seen(fitness, LEAST_PICTURES_HZ + 1.0) == ""
    assert "7 pictures a second and need 12" in seen(Fitness(simulated=True), 7.0)
    assert seen(Fitness(simulated=True), -1.0) == "", "of a page that is not in front nothing is known"


def test_with_force_the_contracts_count_and_the_picture_does_not() -> None:
    fitness = Fitness(simulated=False)
    assert seen(fitness, 3.0) == ""
    fitness.take_rig(LATE, frozenset())
    assert fitness.practice_only.startswith("a part of the rig is late")
    fitness.take_rig(LATE, frozenset({"physics"}))
    assert fitness.practice_only == ""


def test_a_clock_that_goes_at_less_than_half_is_slow_motion() -> None:
    slow = Fitness(simulated=True)
    assert "40 % of real time" in seen(slow, 20.0, 0.4)
    assert slow.speed == pytest.approx(0.4, rel=0.05)
    assert seen(Fitness(simulated=True), 20.0, 0.8) == ""


def test_slow_motion_by_order_is_no_fault_of_the_machine() -> None:
    fitness = Fitness(simulated=True)
    for k in range(60):
        fitness.take_tick(0.1 * k, 10 * k, 0.1)
    assert (fitness.speed, fitness.practice_only) == (1.0, "")


@pytest.mark.parametrize("simulated", [False, True])
def test_a_stopped_rig_is_told_with_what_to_do(simulated: bool) -> None:
    fitness = Fitness(simulated=simulated)
    fitness.take_rig(bodies.SupervisorState(state="safe_stop", safe_stop=True), frozenset())
    assert "press Arm" in fitness.practice_only


def test_the_arms_without_force_are_those_whose_drivers_say_so() -> None:
    told = set()
    for name in known_drivers():
        try:
            driver = importlib.import_module(f"trocar.services.gateway.drivers.{name}").Driver
        except ImportError:  # of a package that is not installed
            continue
        if not name.startswith("grasp_") and not driver.has_force:
            told.add(name)
    assert told <= set(FORCELESS)
    assert set(FORCELESS) <= set(known_drivers())


def test_a_rig_whose_hands_feel_nothing_waits_and_no_other_may() -> None:
    mouse, stub = load_rig("mouse"), load_rig("stub")
    assert mouse.simulated_time
    assert "physics" not in mouse.in_its_time().contracts.loops
    assert "visualization" in mouse.in_its_time().contracts.loops
    assert not stub.simulated_time
    assert stub.in_its_time() is stub
    assert not load_rig("mouse", ("time=clock",)).simulated_time
    assert load_rig("stub", ("time=simulated",)).simulated_time, "nobody holds a simulated arm"
    with pytest.raises(ConfigError, match="gives force to a hand"):
        load_rig("hardware", ("time=simulated",))
