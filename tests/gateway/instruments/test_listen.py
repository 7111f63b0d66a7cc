from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from tests.gateway.kicks import ENDLESS_N
from trocar.services.gateway import __main__ as gateway
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.servo.engagement import EngagementState


class Flood:
    """A bus whose reader always has a frame, never one that may be used."""

    def __init__(self) -> None:
        self.looks = 0

    def wait(self, _topic: str, _until_ns: int) -> bool:
        return True

    def latest(self, _topic: str) -> None:
        self.looks += 1


def test_a_publisher_that_floods_gets_a_few_looks_a_tick_and_no_more() -> None:
    flood: Any = Flood()
    answers: Any = SimpleNamespace(outstanding=True, accept=None)
    gateway.listen(flood, answers, time.monotonic_ns() + 10_000_000_000)
    assert 1 <= flood.looks <= 10


def test_an_answered_tick_listens_no_longer() -> None:
    flood: Any = Flood()
    answers: Any = SimpleNamespace(outstanding=False)
    gateway.listen(flood, answers, time.monotonic_ns() + 10_000_000_000)
    assert flood.looks == 0


class Quiet:
    """A bus on which the answer lies, and which nobody may wait for."""

    def __init__(self) -> None:
        self.taken: list[str] = []

    def latest(self, topic: str) -> str:
        self.taken.append(topic)
        return "frame"


def test_an_answer_is_taken_once_and_without_being_waited_for() -> None:
    bus: Any = Quiet()
    accepted: list[Any] = []
    answers: Any = SimpleNamespace(outstanding=True, accept=lambda frame, _now_ns: accepted.append(frame))
    gateway.take_model(bus, answers)
    answers.outstanding = False
    gateway.take_model(bus, answers)
    assert (bus.taken, accepted) == ([gateway.MODEL], ["frame"])


class Waited(Quiet):
    """A bus on which the answer comes while somebody waits for it."""

    def wait(self, _topic: str, _until_ns: int) -> bool:
        return True


def test_a_model_that_is_waited_for_is_dated_when_it_comes_and_looked_into_later() -> None:
    bus: Any = Waited()
    came: list[int] = []
    answers: Any = SimpleNamespace(outstanding=True, accept=lambda _frame, now_ns: came.append(now_ns))
    before = time.monotonic_ns()
    came_ns = gateway.notice(bus, answers, 0)
    assert bus.taken == []
    assert before <= came_ns <= time.monotonic_ns()
    gateway.take_model(bus, answers, came_ns)
    assert came == [came_ns]
    answers.outstanding = False
    assert gateway.notice(bus, answers, 0) == 0


def test_hands_are_let_go_before_the_process_ends() -> None:
    servo = Servo(ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, ENDLESS_N), ramp_s=0.0)
    servo.engagement.state = EngagementState.ACTIVE
    servo.engagement.gain = 1.0
    servo.force_n[2] = 1.0
    instrument: Any = SimpleNamespace(servo=servo)
    assert not gateway.let_go([instrument])
    assert (servo.engagement.state, servo.engagement.gain) == (EngagementState.READY, 0.0)
    servo.force_n[2] = 0.0
    assert gateway.let_go([instrument])
