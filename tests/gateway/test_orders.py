from __future__ import annotations

import pytest

from protocol import Frame
from protocol.bodies import SupervisorState
from services.gateway.engagement import Engagement, State
from services.gateway.orders import Orders


class Stub:
    """What `Orders` uses of an instrument."""

    def __init__(self) -> None:
        self.servo = self
        self.engagement = Engagement(ramp_s=0.0)
        self.engagement.open(calibrated=True)
        self.armed = 0

    def arm_anew(self) -> None:
        self.armed += 1
        self.engagement.arm()


def _frame(safe_stop: bool, incarnation: int = 1) -> Frame:
    body = SupervisorState(state="running", safe_stop=safe_stop)
    return Frame(1, "supervisor.state", 1, incarnation, 0, 0, 0, True, body)


@pytest.fixture
def engaged() -> tuple[Orders, Stub]:
    stub = Stub()
    for _ in range(200):
        stub.engagement.step(1e-3, fresh=True, alive=True, demand_n=0.0, calibrated=True)
    assert stub.engagement.state is State.ACTIVE
    return Orders([stub]), stub  # type: ignore[list-item]


def test_a_safe_stop_is_latched_until_the_same_supervisor_arms(engaged: tuple[Orders, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(False), _frame(True)])
    assert (stub.engagement.gain, orders.stopped) == (0.0, True)
    for _ in range(300):
        stub.engagement.step(1e-3, fresh=True, alive=True, demand_n=0.0, calibrated=True)
    assert stub.engagement.state is State.READY
    orders.obey([_frame(False)])
    assert (stub.armed, orders.stopped) == (1, False)


def test_a_supervisor_that_starts_anew_does_not_arm(engaged: tuple[Orders, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(True, incarnation=1)])
    orders.obey([_frame(False, incarnation=2)])
    assert (stub.armed, orders.stopped) == (0, True)
    orders.obey([_frame(True, incarnation=2), _frame(False, incarnation=2)])
    assert stub.armed == 1


def test_running_frames_do_not_arm_again_and_again(engaged: tuple[Orders, Stub]) -> None:
    orders, stub = engaged
    orders.obey([_frame(False)] * 5)
    assert stub.armed == 0
