from __future__ import annotations

import pytest

from trocar.protocol import Frame
from trocar.protocol.bodies import SupervisorState
from trocar.services.gateway.orders.supervisor_commands import SupervisorCommands
from trocar.services.gateway.servo.engagement import Engagement, State


class Stub:
    """What `SupervisorCommands` uses of an instrument."""

    def __init__(self) -> None:
        self.servo = self
        self.engagement = Engagement(ramp_s=0.0)
        self.engagement.open(calibrated=True)
        self.armed = self.tried = 0

    def rearm(self) -> None:
        self.armed += 1
        self.engagement.arm()

    def try_again(self) -> None:
        self.tried += 1


def _frame(safe_stop: bool, incarnation: int = 1, armed: int = 0) -> Frame:
    body = SupervisorState(state="running", safe_stop=safe_stop, armed=armed)
    return Frame(1, "supervisor.state", 1, incarnation, 0, 0, 0, True, body)


@pytest.fixture
def engaged() -> tuple[SupervisorCommands, Stub]:
    stub = Stub()
    for _ in range(200):
        stub.engagement.step(1e-3, fresh=True, alive=True, demand_n=0.0, calibrated=True)
    assert stub.engagement.state is State.ACTIVE
    return SupervisorCommands([stub], 2.0), stub  # type: ignore[list-item]


def test_a_safe_stop_is_latched_until_the_same_supervisor_arms(engaged: tuple[SupervisorCommands, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(False), _frame(True)], 1)
    assert (stub.engagement.gain, orders.stopped) == (0.0, True)
    for _ in range(300):
        stub.engagement.step(1e-3, fresh=True, alive=True, demand_n=0.0, calibrated=True)
    assert stub.engagement.state is State.READY
    orders.obey([_frame(False)], 1)
    assert (stub.armed, orders.stopped) == (1, False)


def test_a_supervisor_that_starts_anew_does_not_arm(engaged: tuple[SupervisorCommands, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(True, incarnation=1)], 1)
    orders.obey([_frame(False, incarnation=2)], 1)
    assert (stub.armed, orders.stopped) == (0, True)
    orders.obey([_frame(True, incarnation=2), _frame(False, incarnation=2)], 1)
    assert stub.armed == 1


def test_running_frames_do_not_arm_again_and_again(engaged: tuple[SupervisorCommands, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(False)] * 5, 1)
    assert stub.armed == 0


def test_arming_a_running_rig_tries_again_once_what_is_at_fault(engaged: tuple[SupervisorCommands, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(False, armed=1)], 1)
    assert stub.tried == 0, "who armed it did so before this gateway was there"
    orders.obey([_frame(False, armed=2), _frame(False, armed=2)], 2)
    assert (stub.tried, stub.armed) == (1, 0)
    assert stub.engagement.state is State.ACTIVE, "no hand is let go for that"
    orders.obey([_frame(False, incarnation=2, armed=3)], 3)
    assert stub.tried == 1, "a supervisor that starts anew does not arm"


def test_arming_does_not_end_the_safe_stop_of_another_supervisor(engaged: tuple[SupervisorCommands, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(True)], 1)
    orders.obey([_frame(False, incarnation=2), _frame(False, incarnation=2, armed=1)], 2)
    assert (stub.tried, stub.armed, orders.stopped) == (0, 0, True)


SECOND_NS = 1_000_000_000


def _live(stub: Stub, seconds: float) -> None:
    for _ in range(round(seconds * 1e3)):
        stub.engagement.step(1e-3, fresh=True, alive=True, demand_n=0.0, calibrated=True)


def test_without_a_supervisor_hands_are_let_go_as_for_a_dead_stream(engaged: tuple[SupervisorCommands, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(False)], SECOND_NS)
    orders.obey([], 3 * SECOND_NS)
    _live(stub, 0.01)
    assert (stub.engagement.state, orders.unsupervised) == (State.ACTIVE, False)
    orders.obey([], 3 * SECOND_NS + 1)
    _live(stub, 0.5)
    assert (stub.engagement.state, stub.engagement.gain, orders.unsupervised) == (State.STALE, 0.0, True)
    orders.obey([_frame(False, incarnation=2)], 9 * SECOND_NS)
    _live(stub, 0.05)
    assert stub.engagement.state is State.STALE, "not before the stream has been fresh for a while"
    _live(stub, 0.2)
    assert stub.engagement.state is State.ACTIVE


def test_force_does_not_begin_before_a_supervisor_was_heard_unless_there_is_none() -> None:
    for timeout_s, state in ((2.0, State.READY), (None, State.ACTIVE)):
        stub = Stub()
        orders = SupervisorCommands([stub], timeout_s)  # type: ignore[list-item]
        for tick in range(500):
            orders.obey([], tick)
            _live(stub, 0.001)
        assert stub.engagement.state is state
