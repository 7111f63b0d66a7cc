"""Commands have an age, and an answer says what came of them."""

from __future__ import annotations

import pytest

import protocol.bodies as bodies
from services.supervisor.commands import Command, What
from services.supervisor.state_machine import RigState
from tests.supervisor.made_up import Bench, rig


@pytest.fixture
def bench() -> Bench:
    made = Bench(rig())
    made.run(5.0, lambda: made.supervisor.state is RigState.RUNNING)
    return made


def ask(bench: Bench, what: What, before_s: float = 2.5, incarnation: int | None = None) -> int:
    """Ask for it until so many seconds from now; return its number."""
    supervisor = bench.supervisor
    before = bench.now_s - supervisor.started_s + before_s
    rig_asked = supervisor.incarnation if incarnation is None else incarnation
    order = bodies.Order(id=5, what="new") if what == "attempt" else None
    command = Command(what=what, who="a test", incarnation=rig_asked, before_s=before, order=order)
    supervisor.commands.take(command, bench.now_s)
    return command.id


def answer(bench: Bench, number: int) -> bodies.Answer | None:
    return next((each for each in bench.supervisor.commands.answers if each.order == number), None)


@pytest.mark.parametrize("what", ["arm", "safe_stop", "attempt", "switch"])
@pytest.mark.parametrize(("before_s", "other"), [(-11.0, 0), (float("nan"), 0), (2.5, 1)])
def test_what_its_sender_has_given_up_on_or_meant_for_another_run_is_not_done(
    bench: Bench, what: What, before_s: float, other: int
) -> None:
    """A page that hung for 14 s armed the rig, after `trocar arm` had failed."""
    number = ask(bench, what, before_s, bench.supervisor.incarnation + other)
    said = answer(bench, number)
    assert said is not None
    assert not said.ok
    assert said.text.endswith("nothing was done")
    body = bench.supervisor.body()
    assert (body.armed, body.safe_stop, body.orders, bench.supervisor.next_scenario) == (0, False, (), "")


def test_a_safe_stop_is_answered_when_the_gateway_has_let_go(bench: Bench) -> None:
    number = ask(bench, "safe_stop")
    bench.run(1.0)
    assert bench.supervisor.state is RigState.SAFE_STOP
    assert answer(bench, number) is None, "the gateway has not obeyed yet"
    bench.peers["gateway"].gauges["safe_stop"] = 1.0
    bench.run(0.2)
    assert answer(bench, number) == bodies.Answer(order=number, ok=True, text="safe stop: every hand is let go")
    number = ask(bench, "arm")
    bench.run(0.1)
    bench.peers["gateway"].gauges["safe_stop"] = 0.0
    bench.run(0.4)
    assert answer(bench, number) == bodies.Answer(order=number, ok=True, text="armed: hands may be pushed")


def test_a_gateway_that_does_not_obey_is_told_while_somebody_waits(bench: Bench) -> None:
    number = ask(bench, "safe_stop")
    assert bench.run(2.5, lambda: answer(bench, number) is not None) < 2.2
    said = answer(bench, number)
    assert said is not None
    assert (said.ok, said.text) == (False, "safe stop, but the gateway has not said that it obeys")


def test_without_a_gateway_no_hand_is_pushed(bench: Bench) -> None:
    bench.peers["gateway"].alive = False
    bench.run(6.0)
    number = ask(bench, "safe_stop")
    bench.run(0.1)
    said = answer(bench, number)
    assert said is not None
    assert (said.ok, said.text) == (True, "safe stop: no gateway runs")


def test_an_order_of_the_attempt_is_passed_on_as_long_as_its_sender_waits(bench: Bench) -> None:
    ask(bench, "attempt", before_s=0.5)
    assert len(bench.supervisor.body().orders) == 1
    bench.run(0.6)
    assert bench.supervisor.body().orders == ()
