"""Commands have an age, and an answer says what came of them."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import Bench, rig
from trocar.services.supervisor.control.commands import Command, What
from trocar.services.supervisor.crew.crew import Launch
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.judge.state_machine import RigState


@pytest.fixture
def bench() -> Bench:
    made = Bench(rig())
    made.run(5.0, lambda: made.supervisor.state is RigState.RUNNING)
    return made


Answers = list[bodies.Answer]


def ask(bench: Bench, what: What, before_s: float = 2.5, incarnation: int | None = None) -> Answers:
    """Ask for it until so many seconds from now; return what will be answered."""
    supervisor = bench.supervisor
    before = bench.now_s - supervisor.started_s + before_s
    rig_asked = supervisor.incarnation if incarnation is None else incarnation
    order = bodies.Order(id=5, what="new") if what == "attempt" else None
    command = Command(what=what, who="a test", incarnation=rig_asked, before_s=before, order=order)
    answers: Answers = []
    supervisor.commands.take_command(command, bench.now_s, answers.append)
    return answers


def done(text: str, ok: bool = True) -> Answers:
    return [bodies.Answer(order=0, ok=ok, text=text)]


@pytest.mark.parametrize("what", ["arm", "safe_stop", "attempt", "switch", "restart"])
@pytest.mark.parametrize(("before_s", "other"), [(-11.0, 0), (0.4, 0), (0.9, 0), (float("nan"), 0), (2.5, 1)])
def test_what_its_sender_has_given_up_on_or_meant_for_another_run_is_not_done(
    bench: Bench, what: What, before_s: float, other: int
) -> None:
    """A page that hung for 14 s, or for 2.6 s, armed the rig after `trocar arm` had failed."""
    (said,) = ask(bench, what, before_s, bench.supervisor.incarnation + other)
    assert not said.ok
    assert said.text.endswith("nothing was done")
    body = bench.supervisor.body()
    assert (body.armed, body.safe_stop, body.orders, bench.supervisor.next_scenario) == (0, False, (), "")
    assert not bench.supervisor.begins_again


def test_a_new_start_is_answered_and_asked_for(bench: Bench) -> None:
    assert ask(bench, "restart") == done("the rig begins: a few seconds.")
    assert bench.supervisor.begins_again
    assert bench.supervisor.next_scenario == ""


def test_a_safe_stop_is_answered_when_the_gateway_has_let_go(bench: Bench) -> None:
    answers = ask(bench, "safe_stop")
    bench.run(1.0)
    assert bench.supervisor.state is RigState.SAFE_STOP
    assert answers == [], "the gateway has not obeyed yet"
    bench.peers["gateway"].gauges["safe_stop"] = 1.0
    bench.run(0.2)
    assert answers == done("safe stop: every hand is let go")
    answers = ask(bench, "arm")
    bench.run(0.1)
    bench.peers["gateway"].gauges["safe_stop"] = 0.0
    bench.run(0.4)
    assert answers == done("armed: hands may be pushed")


def test_a_gateway_that_does_not_obey_is_told_while_somebody_waits(bench: Bench) -> None:
    answers = ask(bench, "safe_stop")
    assert bench.run(2.5, lambda: bool(answers)) < 2.2
    assert answers == done("safe stop, but the gateway has not said that it obeys", ok=False)


def test_a_command_that_is_begun_at_the_last_moment_is_still_confirmed(bench: Bench) -> None:
    bench.peers["gateway"].gauges["safe_stop"] = 0.0
    assert ask(bench, "arm", before_s=1.09) != []
    answers = ask(bench, "arm", before_s=1.11)
    bench.run(0.5)
    assert answers == done("armed: hands may be pushed")
    assert bench.supervisor.body().armed == 1


@pytest.mark.parametrize(("what", "begun"), [("arm", "armed"), ("safe_stop", "safe stop")])
@pytest.mark.parametrize("silent_s", [0.2, 6.0], ids=["hung", "lost"])
def test_a_gateway_of_others_that_is_silent_may_still_push(
    bench: Bench, what: What, begun: str, silent_s: float
) -> None:
    """A gateway that was stopped for 2.5 s was said not to run; it pushed again when it went on."""
    bench.peers["gateway"].alive = False
    bench.run(silent_s)
    answers = ask(bench, what)
    bench.run(2.5)
    assert answers == done(f"{begun}, but the gateway is not heard: whether it obeys is unknown", ok=False)


def test_a_gateway_of_others_that_goes_on_in_time_confirms(bench: Bench) -> None:
    bench.peers["gateway"].alive = False
    bench.run(6.0)
    answers = ask(bench, "safe_stop")
    bench.run(0.5)
    bench.peers["gateway"].alive, bench.peers["gateway"].gauges["safe_stop"] = True, 1.0
    bench.run(0.5)
    assert answers == done("safe stop: every hand is let go")


@pytest.mark.parametrize("runs", [True, False])
def test_only_a_gateway_of_ours_is_known_to_have_ended(bench: Bench, tmp_path: Path, runs: bool) -> None:
    crew = bench.supervisor.crew
    crew.launch = Launch((), tmp_path)
    crew.members["gateway"].child = Mock(spec=Child) if runs else None
    assert ask(bench, "safe_stop") == ([] if runs else done("safe stop, for the next gateway: none runs"))


def test_an_order_of_the_attempt_is_passed_on_as_long_as_its_sender_waits(bench: Bench) -> None:
    answers = ask(bench, "attempt", before_s=1.2)
    assert len(bench.supervisor.body().orders) == 1
    bench.run(1.3)
    assert bench.supervisor.body().orders == ()
    assert answers == done("the training process did not answer: nothing is done any more", ok=False)


def test_an_order_of_the_attempt_is_answered_by_who_carries_it_out(bench: Bench) -> None:
    answers = ask(bench, "attempt")
    said = (bodies.Answer(order=4, ok=False), bodies.Answer(order=5, ok=True, text="a new attempt begins"))
    attempt = bodies.Attempt(begins=0, state="running", answers=said)
    bench.peers["training"].bus.publish("training.attempt", attempt)
    bench.run(0.1)
    assert answers == [said[1]]
