"""Begin again, pause and slow motion at the gateway: only limp arms, never a step of force, time as it is told."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gateway.kicks import ENDLESS_N
from trocar.protocol import Frame
from trocar.protocol.bodies import Attempt, LocalModel
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.orders.attempt_orders import AttemptOrders
from trocar.services.gateway.orders.rig_time import RigTime

MS = 1_000_000
RATE_N_S, FULL_N = 200.0, 2.0
LIMITS = ServoLimits(
    force_n=3.0, continuous_force_n=3.0, force_rate_n_s=RATE_N_S, torque_nm=0.3, velocity_m_s=2.0,
    count_m=1e-5, friction_n=ENDLESS_N,
)  # fmt: skip


class Stub:
    """An instrument that presses on a wall, whose model comes fresh in each tick of the rig's time."""

    def __init__(self) -> None:
        self.servo = Servo(LIMITS, ramp_s=0.05)
        self.servo.engagement.open(calibrated=True)
        self.begun = 0
        self.paces: list[float] = []
        self.forces_n: list[float] = []
        self.demand_n = 0.0

    def begin_again(self) -> None:
        assert self.servo.limp, "hands are put back only where no arm bears a force"
        self.begun += 1
        self.demand_n = 0.0

    def keep_pace(self, pace: float) -> None:
        assert self.servo.limp or pace == 1.0
        self.paces.append(pace)


class Bench:
    """A gateway's loop around the orders."""

    def __init__(self) -> None:
        self.stub, self.time = Stub(), RigTime(MS)
        self.orders = AttemptOrders([self.stub], self.time)  # type: ignore[list-item]
        self.now = 0
        self.ticks: list[int] = []

    def tell(self, incarnation: int = 1, fresh: bool = True, **said: float) -> None:
        body = Attempt(**{"begins": 0, **said})  # type: ignore[arg-type]
        self.orders.obey(Frame(1, "training.attempt", 1, incarnation, 0, 0, 0, True, body), fresh)

    def run(self, ticks: int) -> None:
        motion, stub = np.zeros(6), self.stub
        for _ in range(ticks):
            self.now += 1
            before = self.time.index
            self.time.advance(self.now, self.now * MS)
            self.orders.turn()
            if self.time.index > before:
                push = LocalModel(force_n=(0.0, 0.0, stub.demand_n), in_contact=True)
                stub.servo.accept(np.array(push.row()), 0.02, self.now * MS, 1)
            stub.servo.step(self.now * MS, motion, 0.0, calibrated=True)
            stub.forces_n.append(float(stub.servo.force_n[2]))
            self.ticks.append(self.time.index)

    def press(self) -> None:
        """Let the hand feel the wall at full force."""
        self.run(300)
        self.stub.demand_n = FULL_N
        self.run(100)
        assert self.stub.forces_n[-1] == pytest.approx(FULL_N)

    def assert_never_a_kick(self) -> None:
        assert np.abs(np.diff(self.stub.forces_n)).max() <= RATE_N_S * 1e-3 + 1e-9


@pytest.fixture
def pressed() -> Bench:
    bench = Bench()
    bench.tell()
    bench.press()
    return bench


def test_at_full_pace_ticks_are_those_of_the_loop_and_lost_ones_are_lost() -> None:
    time = RigTime(MS)
    found = []
    for loop in (0, 1, 2, 7, 8):
        time.advance(loop, 50 * MS + loop * MS)
        found.append((time.index, time.time_ns // MS))
    assert found == [(0, 50), (1, 51), (2, 52), (7, 57), (8, 58)]


@pytest.mark.parametrize("pace", [1 / 32, 0.25, 0.7])
def test_slow_motion_goes_on_by_single_ticks_at_its_pace(pace: float) -> None:
    time = RigTime(MS)
    time.advance(0, 0)
    time.pace = pace
    found = []
    for loop in range(1, 3201):
        time.advance(loop, loop * MS)
        found.append(time.index)
    assert set(np.diff(found)) <= {0, 1}
    assert found[-1] == pytest.approx(3200 * pace, abs=1)
    time.pace = 1.0
    time.advance(3201, 3201 * MS)
    assert time.index == found[-1] + 1
    assert time.time_ns == time.index * MS


def test_a_scene_begins_again_once_the_force_has_faded_and_force_comes_back(pressed: Bench) -> None:
    pressed.tell(begins=1)
    pressed.run(5)
    assert (pressed.orders.begins, pressed.stub.begun) == (0, 0), "there is force yet"
    pressed.tell(begins=1)
    pressed.run(300)
    assert (pressed.orders.begins, pressed.stub.begun) == (1, 1)
    assert pressed.stub.servo.engagement.gain == 1.0
    pressed.stub.demand_n = FULL_N
    pressed.run(100)
    assert pressed.stub.forces_n[-1] == pytest.approx(FULL_N)
    assert min(pressed.stub.forces_n[400:]) == 0.0
    assert pressed.time.index == pressed.now - 1, "time has not stood"
    pressed.assert_never_a_kick()


def test_time_stands_with_limp_arms_while_the_rig_starts_and_goes_once_it_is_ready(pressed: Bench) -> None:
    pressed.orders.starting = True
    pressed.tell()
    pressed.run(200)
    assert len(set(pressed.ticks[-100:])) == 1
    assert pressed.stub.forces_n[-1] == 0.0
    pressed.orders.starting = False
    pressed.tell()
    pressed.run(200)
    assert pressed.ticks[-1] - pressed.ticks[-101] == 100
    pressed.assert_never_a_kick()


def test_time_stands_and_goes_only_with_limp_arms(pressed: Bench) -> None:
    first = len(pressed.ticks)
    pressed.tell(pace=0.0)
    pressed.run(200)
    stands = next(k for k in range(first, len(pressed.ticks)) if pressed.ticks[k] == pressed.ticks[k - 1])
    assert stands - first >= FULL_N / (RATE_N_S * 1e-3) - 1
    assert pressed.stub.forces_n[stands] == 0.0
    assert len(set(pressed.ticks[stands:])) == 1
    pressed.tell(pace=0.0, steps=3)
    pressed.run(50)
    assert pressed.ticks[-1] == pressed.ticks[stands] + 3
    assert not any(pressed.stub.forces_n[stands:])
    pressed.tell(pace=0.25, steps=3)
    pressed.run(400)
    assert pressed.ticks[-1] == pytest.approx(pressed.ticks[stands] + 3 + 100, abs=1)
    assert not any(pressed.stub.forces_n[stands:])
    pressed.stub.demand_n = 0.0  # who feels nothing does not go on pressing
    pressed.tell(pace=1.0, steps=3)
    pressed.run(200)
    pressed.stub.demand_n = FULL_N
    pressed.run(100)
    assert pressed.stub.forces_n[-1] == pytest.approx(FULL_N)
    assert pressed.stub.paces == [0.0, 0.25, 1.0]
    pressed.assert_never_a_kick()


@pytest.mark.parametrize("pace", [0.0, 0.3, 1.0])
def test_a_scene_begins_again_while_time_stands_with_a_tick_of_its_own(pressed: Bench, pace: float) -> None:
    """What physics made of a tick that it has taken is not to be undone: a recording has one frame of each tick."""
    pressed.tell(pace=0.0)
    pressed.run(100)
    stood, begins = pressed.time.index, dict[int, set[int]]()
    pressed.tell(begins=1, pace=pace)
    for _ in range(300):
        pressed.run(1)
        begins.setdefault(pressed.time.index, set()).add(pressed.orders.begins)
    assert begins[stood] == {0}
    assert begins[stood + 1] == {1}
    assert pressed.time.pace == pace
    assert pressed.stub.servo.engagement.gain == (pace == 1.0)
    pressed.assert_never_a_kick()


def test_a_training_process_that_dies_leaves_no_rig_that_stands(pressed: Bench) -> None:
    pressed.tell(pace=0.0)
    pressed.run(100)
    pressed.orders.obey(None, fresh=False)
    pressed.run(10)
    assert pressed.time.pace == 1.0


def test_one_that_starts_anew_begins_nothing_by_that(pressed: Bench) -> None:
    pressed.tell(begins=5)
    pressed.run(100)
    pressed.tell(begins=0, incarnation=2)
    pressed.tell(begins=0, incarnation=2)
    pressed.run(10)
    assert pressed.orders.begins == 1
    pressed.tell(begins=1, incarnation=2)
    pressed.run(100)
    assert pressed.orders.begins == 2
