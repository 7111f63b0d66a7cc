"""Silence, starvation and being stopped, on a member whose clock and child the test holds."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from tests.supervisor.made_up import health
from trocar.services.supervisor.crew import hang_detection
from trocar.services.supervisor.crew.member import Member, MemberState
from trocar.services.supervisor.crew.processes import TABLE
from trocar.services.supervisor.crew.restart_policy import RestartPolicy
from trocar.services.supervisor.crew.scheduler_state import Waits
from trocar.services.supervisor.judge.window import Window

LIMITS = hang_detection.Limits(heartbeat_s=0.5, stream_s=0.06, ready_s=10.0)


@dataclass
class Child:
    """Stands for `launcher.Child`: only how long it waited for a processor matters here."""

    pid: int = 7
    waited: float = 0.0
    bus_waited: float = 0.0

    def waits(self) -> Waits:
        return Waits(self.waited, self.bus_waited)


def member(name: str, state: MemberState = MemberState.READY, *, heard_s: float = 100.0) -> Member:
    spec = next(spec for spec in TABLE if spec.name == name)
    made = Member(spec, True, True, RestartPolicy((0.1,), 5), Window(60.0), state)
    made.child = Child()  # type: ignore[assignment]
    made.hear(health(name), heard_s)
    made.since_s = 90.0
    made.stream_s = heard_s if spec.stream else None
    return made


@pytest.mark.parametrize(
    ("name", "silence_s", "sentence"),
    [
        ("physics", 0.05, ""),
        ("physics", 0.07, "physics.state: silent for 70 ms, limit 60 ms"),
        ("recorder", 0.49, ""),
        ("recorder", 0.60, "recorder.health: silent for 600 ms, limit 500 ms"),
    ],
)
def test_silence(name: str, silence_s: float, sentence: str) -> None:
    assert hang_detection.hang(member(name), False, 100.0 + silence_s, LIMITS) == sentence


def test_a_starving_process_is_not_silent_but_its_stream_is() -> None:
    for name, said in (("recorder", ""), ("physics", "physics.state: silent")):
        starving = member(name)
        starving.child.waited = 0.4  # type: ignore[union-attr]
        assert hang_detection.hang(starving, False, 100.8, LIMITS).startswith(said)
        assert bool(hang_detection.hang(starving, False, 100.8, LIMITS)) is bool(said)


def test_silence_of_one_who_was_not_run_is_told_as_such() -> None:
    starving = member("physics")
    starving.child.waited = 0.06  # type: ignore[union-attr]
    said = "physics.state: silent for 70 ms, limit 60 ms; it waited 60 ms for a processor"
    assert hang_detection.hang(starving, False, 100.07, LIMITS) == said


@pytest.mark.parametrize(
    ("loop_s", "bus_s", "said"),
    [
        (0.06, 0.05, "; it waited 60 ms and its bus waited 50 ms for a processor"),  # together more than the silence
        (0.0, 0.05, "; its bus waited 50 ms for a processor"),
        (0.004, 0.004, ""),
    ],
)
def test_waits_of_the_loop_and_of_the_bus_are_told_apart(loop_s: float, bus_s: float, said: str) -> None:
    starving = member("physics")
    starving.child.waited, starving.child.bus_waited = loop_s, bus_s  # type: ignore[union-attr]
    silent = "physics.state: silent for 70 ms, limit 60 ms"
    assert hang_detection.hang(starving, False, 100.07, LIMITS) == silent + said


def test_a_starving_process_is_not_ended_a_hanging_one_is() -> None:
    hung = member("physics", MemberState.HUNG)
    assert hang_detection.beyond_waiting(hung, False, 100.6, LIMITS)
    hung.child.waited = 0.5  # type: ignore[union-attr]
    assert not hang_detection.beyond_waiting(hung, False, 100.6, LIMITS)
    assert hang_detection.beyond_waiting(hung, True, 100.6, LIMITS)  # held by a signal, whatever it waited
    assert hang_detection.beyond_waiting(hung, False, 101.1, LIMITS)
    hung.child.waited = 4.7  # type: ignore[union-attr]
    assert not hang_detection.beyond_waiting(hung, False, 105.3, LIMITS), "it was hardly run"
    assert hang_detection.beyond_waiting(hung, True, 105.3, LIMITS)
    assert hang_detection.beyond_waiting(hung, False, 106.0, LIMITS)


def test_who_runs_in_circles_is_ended_on_the_busiest_machine_too() -> None:
    """It waits for nine tenths of the time, as all do there; in the tenth that it has it says nothing."""
    hung = member("recorder", MemberState.HUNG)
    ended_s = None
    for second in range(1, 120):
        hung.child.waited = 0.9 * second  # type: ignore[union-attr]
        if hang_detection.beyond_waiting(hung, False, 100.0 + second, LIMITS):
            ended_s = second
            break
    assert ended_s == pytest.approx(50, abs=2)


def test_being_stopped_is_told_at_once_even_while_starting() -> None:
    starting = member("physics", MemberState.STARTING)
    assert (
        hang_detection.hang(starting, True, 100.0, LIMITS) == "physics: process 7 is stopped by a signal, limit 500 ms"
    )
    hung = member("physics", MemberState.HUNG)
    said = hang_detection.hang(hung, True, hung.since_s + 0.2, LIMITS)
    assert said == "physics: process 7 is stopped by a signal for 200 ms, limit 500 ms"
    assert hang_detection.hang(starting, False, 199.0, LIMITS) == ""


def test_the_start_may_take_its_time_on_the_processor() -> None:
    starting = member("physics", MemberState.STARTING)
    assert not hang_detection.is_overdue(starting, 99.9, LIMITS)
    assert hang_detection.is_overdue(starting, 100.1, LIMITS)
    starting.child.waited = 5.0  # type: ignore[union-attr]
    assert not hang_detection.is_overdue(starting, 104.9, LIMITS)


def test_a_start_that_makes_progress_goes_on_and_one_that_says_the_same_again_does_not() -> None:
    starting = member("physics", MemberState.STARTING)
    starting.advance(("contact: 3 kernels compiled", 0.1), 95.0)
    assert not hang_detection.is_overdue(starting, 100.1, LIMITS)
    for now_s in (96.0, 100.0, 104.0):
        starting.advance(("contact: 3 kernels compiled", 0.1), now_s)
    overdue_s = 95.0 + LIMITS.ready_s
    assert not hang_detection.is_overdue(starting, overdue_s - 0.1, LIMITS)
    assert hang_detection.is_overdue(starting, overdue_s + 0.1, LIMITS)


def test_ready_is_said_and_heard() -> None:
    assert hang_detection.says_ready(member("physics"), 100.05, LIMITS)
    assert not hang_detection.says_ready(member("physics"), 100.07, LIMITS)  # its stream is not heard
    assert hang_detection.says_ready(member("recorder"), 100.4, LIMITS)
    building = member("recorder")
    building.hear(health("recorder", state="starting"), 100.0)
    assert not hang_detection.says_ready(building, 100.0, LIMITS)


def test_health_of_another_process_under_this_name_is_not_heard() -> None:
    owned = member("recorder")
    assert owned.hear(health("recorder", pid=8), 200.0) is False
    assert owned.heard_s == 100.0
