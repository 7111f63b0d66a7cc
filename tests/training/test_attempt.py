"""The state machine of one attempt: begin, clock, goal, what does not count."""

from __future__ import annotations

import pytest

from trocar.services.training.attempt import AttemptState, FollowedAttempt, Observation
from trocar.services.training.hints import hint
from trocar.services.training.rig_observer import RigObserver
from trocar.services.training.scenario import Goal, Scenario

STILL = ((0.0, 0.0, 0.1, 0.5), (0.1, 0.0, 0.1, 0.5))
MOVED = ((0.0, 0.01, 0.1, 0.5), (0.1, 0.0, 0.1, 0.5))
GOAL = Goal(depth_m=0.01, hold_s=1.0, time_limit_s=20.0, forbidden=("E4",))


def _look(tick: int, depth_m: float = 0.0, **more: object) -> Observation:
    return Observation(tick=tick, depth_m=depth_m, **{"hands": MOVED, **more})  # type: ignore[arg-type]


@pytest.fixture
def running() -> FollowedAttempt:
    """Return one that was armed at tick 1000 and moved at 5000."""
    attempt = FollowedAttempt(GOAL)
    attempt.observe(_look(1000, hands=STILL))
    attempt.observe(_look(5000))
    return attempt


@pytest.mark.parametrize(
    ("hands", "begins"),
    [
        (STILL, False),
        (((0.0, 0.003, 0.1, 0.5), STILL[1]), False),
        (((0.0, 0.005, 0.1, 0.5), STILL[1]), True),
        ((STILL[0], (*STILL[1][:3], 0.4)), False),
        ((STILL[0], (*STILL[1][:3], 0.3)), True),
    ],
)
def test_it_runs_from_the_first_motion_of_a_hand_or_a_handle(hands: tuple[object, ...], begins: bool) -> None:
    attempt = FollowedAttempt(GOAL)
    attempt.observe(_look(1000, hands=STILL))
    attempt.observe(_look(9000, hands=hands))
    assert attempt.state is (AttemptState.RUNNING if begins else AttemptState.ARMED)
    assert attempt.time_s == 0.0


def test_its_clock_counts_ticks_of_the_rig_and_so_stands_where_they_do(running: FollowedAttempt) -> None:
    for _ in range(5):
        running.observe(_look(7500))
    assert running.time_s == pytest.approx(2.5)
    assert running.began_tick == 1000


def test_a_goal_is_reached_by_who_stays_there(running: FollowedAttempt) -> None:
    for tick, depth_m in ((6000, 0.0099), (7000, 0.0101), (7900, 0.0101), (7950, 0.009), (8000, 0.0101), (8990, 0.011)):
        running.observe(_look(tick, depth_m))
        assert running.state is AttemptState.RUNNING
    running.observe(_look(9000, 0.011))
    assert (running.state, running.outcome) == (AttemptState.DONE, "success")
    assert running.reason == "11.0 mm deep after 4.0 s"
    running.observe(_look(30_000, 0.0, errors={"E4": 1}))
    assert (running.outcome, running.time_s, running.depth_m) == ("success", 4.0, 0.011)


def test_time_that_is_over_and_what_must_not_happen_end_it() -> None:
    for look, why in ((_look(25_001), "the time of 20 s is over"), (_look(6000, errors={"E4": 1}), "E4 must not")):
        attempt = FollowedAttempt(GOAL)
        for each in (_look(1000, hands=STILL), _look(5000), _look(6000, errors={"E5": 3}), look):
            attempt.observe(each)
        assert attempt.outcome == "failure"
        assert attempt.reason.startswith(why)


@pytest.mark.parametrize(
    ("seen", "outcome"), [(("P2", "P3", "P4"), "success"), (("P3", "P2", "P4"), "failure"), (("P4",), "failure")]
)
def test_phases_come_in_order_where_a_goal_says_so_and_somebody_judges(seen: tuple[str, ...], outcome: str) -> None:
    attempt = FollowedAttempt(Goal(depth_m=0.01, hold_s=0.0, phases=("P2", "P3", "P4")))
    attempt.observe(_look(0, hands=STILL))
    attempt.observe(_look(1))
    for k, phase in enumerate(seen):
        attempt.observe(_look(2 + k, phase=phase))
    attempt.observe(_look(100, 0.011, phase=seen[-1]))
    assert attempt.outcome == outcome


def test_what_makes_it_not_count_stays_and_only_while_it_runs() -> None:
    attempt = FollowedAttempt(GOAL)
    attempt.observe(_look(0, hands=STILL, fault="the rig was late"))
    assert attempt.why_not == "", "nobody has begun"
    attempt.observe(_look(1))
    for fault in ("", "the rig was late", "", "a part of the rig began anew"):
        attempt.observe(_look(2, fault=fault))
    assert attempt.why_not == "the rig was late"
    assert not attempt.ended


def test_abandoned_is_for_good_and_for_what_is_not_done(running: FollowedAttempt) -> None:
    running.abandon("somebody else's turn")
    running.observe(_look(9000, 0.02))
    running.abandon("again")
    assert (running.state, running.reason, running.time_s) == (AttemptState.ABANDONED, "somebody else's turn", 0.0)


def test_without_a_goal_it_goes_on() -> None:
    attempt = FollowedAttempt(None)
    for look in (_look(0, hands=STILL), _look(1), _look(999_999, 0.05)):
        attempt.observe(look)
    assert (attempt.state, attempt.outcome) == (AttemptState.RUNNING, "")


def test_one_that_begins_with_the_catheter_in_does_not_count_and_says_what_to_do() -> None:
    """A training process that comes late would else tell of a success after a second."""
    attempt, clean = FollowedAttempt(GOAL), FollowedAttempt(GOAL)
    attempt.observe(_look(1000, 0.0217, hands=STILL))
    clean.observe(_look(1000, hands=STILL))
    scenario = Scenario(name="basic", title="Slide it in", scene="default", goal=GOAL, hint="Grasp it.")
    assert (attempt.why_not, clean.why_not) == ("the catheter was in at its beginning", "")
    assert hint(attempt, RigObserver(), scenario) == "Begin again: the catheter is in already."
    assert hint(clean, RigObserver(), scenario) == "Grasp it."
