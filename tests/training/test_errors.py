"""Hands that err are caught, each by its own row; a near miss is not; a good attempt has no error at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.training.streams import GOOD, SCENARIO, SITE, Channel, changed, messages
from trocar.protocol.topics import TICK_S
from trocar.services.training.errors import ERRORS, RULES, ErrorEvent, ErrorLog
from trocar.services.training.judge import Judge
from trocar.services.training.procedure import Procedure
from trocar.services.training.scenario import Limit, Scenario
from trocar.services.training.situation import Situation

#: Evidence: what makes it an error, and what is nearly one. Values stand for a tenth of a second longer than it takes.
CASES: dict[tuple[str, str], tuple[dict[str, Channel], dict[str, Channel]]] = {}


def case(code: str, name: str, err: dict[str, Channel], near: dict[str, Channel]) -> None:
    CASES[code, name] = err, near


def pulse(channel: str, value: float, seconds: float, at_s: float = 4.0) -> dict[str, Channel]:
    """A channel of the good attempt that jumps to a value and back."""
    base = GOOD[channel]
    around = [float(np.interp(at, *zip(*base, strict=True))) for at in (at_s, at_s + seconds)]
    outside = [point for point in base if not at_s <= point[0] <= at_s + seconds]
    step = 1e-3
    added = [(at_s, around[0]), (at_s + step, value), (at_s + seconds, value), (at_s + seconds + step, around[1])]
    return {channel: sorted(outside + added)}


def by_value(
    code: str, name: str, channel: str, limit: float, seconds: float, at_s: float = 4.0, **more: Channel
) -> None:
    """5 % beyond the limit for long enough is an error, 5 % within it for as long is none."""
    sign = -1.0 if next(rule.below for rule in RULES if rule.name == name) else 1.0
    beyond, within = (limit * (1.0 + sign * way) for way in (0.05, -0.05))
    case(code, name, pulse(channel, beyond, seconds, at_s) | more, pulse(channel, within, seconds, at_s) | more)


def deep(length_m: float) -> dict[str, Channel]:
    return {"inserted": [(2.5, 0.0), (8.0, length_m), (9.0, length_m)]}


late_grip: dict[str, Channel] = {
    "grip": [(1.999, 0.0), (2.0, 1.0), *GOOD["grip"][2:]],
    "traction": [(1.999, 0.1), (2.0, 0.3)],
}


def outside_at(at_s: float) -> dict[str, Channel]:
    return {"outside": [(at_s, 0.0), (at_s + 1e-3, 1.0)]}


by_value("E1", "traction", "traction", 2.6, 0.2)
by_value("E1", "grasp of the duct", "duct_squeeze", 1.2, 0.2)
by_value("E2", "load on the rim", "rim", 1.0, 0.2, inserted=[(2.5, 0.0), (8.0, 15e-3)], wall=[(0.0, 0.0)])
by_value("E2", "area of the opening", "opening", 1.3, 0.2)
by_value("E3", "push beside the opening", "tip", 0.03, 0.35, at_s=2.0)
case("E3", "withdrawal before a retry",
     {"gap": [(1.0, 6e-3), (2.0, 1e-3), (2.1, 1e-3), (2.2, 3.1e-3), (2.4, 1e-3)]},
     {"gap": [(1.0, 6e-3), (2.0, 1e-3), (2.1, 1e-3), (2.2, 2.9e-3), (2.4, 1e-3)]})  # fmt: skip
by_value("E4", "force at the tip", "tip", 1.0, 0.1, at_s=6.0)
by_value("E4", "depth in the wall", "penetration", 0.5e-3, 0.1)
case("E4", "length left the lumen at once", outside_at(4.425), outside_at(4.242))
by_value("E5", "push without advance", "push", 0.5, 1.0, inserted=[(2.5, 0.0), (4.0, 5e-3), (5.5, 5e-3), (8.0, 15e-3)])
by_value("E5", "arc over chord of the free catheter", "buckle", 1.15, 0.3, at_s=2.6)
case("E6", "secured too deep", deep(21e-3), deep(19e-3))
case("E6", "secured too shallow", deep(9.5e-3), deep(10.5e-3))
case("E7", "length left inside",
     {"inserted": [(2.5, 0.0), (8.0, 15e-3), (14.6, 15e-3), (15.2, 0.95e-3)]},
     {"inserted": [(2.5, 0.0), (8.0, 15e-3), (14.6, 15e-3), (15.2, 1.05e-3)]})  # fmt: skip
by_value("E8", "squeeze of the catheter", "catheter_squeeze", 3.0, 0.2)
case("E8", "radius of the sharpest bend", pulse("bend", 263.0, 0.3), pulse("bend", 238.0, 0.3))
case("E9", "clip crimps", {"clip": [(9.2, 0.0), (9.4, 1.575)]}, {"clip": [(9.2, 0.0), (9.4, 1.425)]})
case("E9", "clip is loose",
     {"clip": [(9.2, 0.0), (9.4, 0.285)], "flush": GOOD["flush"][:4]},
     {"clip": [(9.2, 0.0), (9.4, 0.315)], "flush": GOOD["flush"][:4]})  # fmt: skip


def flushed_inside(seconds: float) -> dict[str, Channel]:
    """Flush for so long inside, with a line that was never flushed outside."""
    return {"flush": [(12.0, 0.0), (12.001, 1.0), (12.0 + seconds, 1.0), (12.001 + seconds, 0.0)]}


case("E10", "air flushed in", flushed_inside(0.062), flushed_inside(0.048))
case("E10", "leak while flushing",
     pulse("clip", 0.28, 0.4, 12.5), pulse("clip", 0.32, 0.4, 12.5))  # fmt: skip
case("E11", "direction of the tip along the duct", pulse("turn", 1.62, 0.3), pulse("turn", 1.52, 0.3))
case(
    "E12",
    "angle off the view",
    pulse("off_view", 0.79, 1.2, 0.6) | late_grip,
    pulse("off_view", 0.71, 1.2, 0.6) | late_grip,
)
case("E12", "distance of the shafts", pulse("apart", 4.75e-3, 0.2, 0.1), pulse("apart", 5.25e-3, 0.2, 0.1))
case("E12", "force out of view",
     pulse("off_view", 0.8, 0.5, 0.6) | pulse("blind", 0.185, 0.3, 0.7) | late_grip,
     pulse("off_view", 0.8, 0.5, 0.6) | pulse("blind", 0.161, 0.3, 0.7) | late_grip)  # fmt: skip


def held_again_at(at_s: float) -> dict[str, Channel]:
    begin = [(0.499, 0.0), (0.5, 1.0), (1.0, 1.0), (1.001, 0.0), (at_s, 0.0), (at_s + 1e-3, 1.0)]
    return {"hold": [*begin, *GOOD["hold"][2:]]}


open_hand: dict[str, Channel] = {"jaw": [(1.0, 0.2), (1.001, 0.6), (1.9, 0.6), (1.901, 0.2), *GOOD["jaw"]]}
case("E13", "time not held",
     held_again_at(1.53) | open_hand,
     held_again_at(1.475) | open_hand)  # fmt: skip
case("E13", "slide in closed jaws", {"slide": [(5.0, 0.0), (5.5, 2.1e-3)]}, {"slide": [(5.0, 0.0), (5.5, 1.9e-3)]})
let_go: dict[str, Channel] = {"hold": [*GOOD["hold"][:2], (6.0, 1.0), (6.001, 0.0)]}
opened: dict[str, Channel] = {"jaw": [(5.999, 0.2), (6.0, 0.6)]}
case("E13", "lost from closed jaws", let_go, let_go | opened)


def grasps(n: int) -> dict[str, Channel]:
    """Let go of the catheter and take it again so often, while it is inside."""
    hold, jaw = [(0.499, 0.0), (0.5, 1.0)], []
    for at_s in (3.0 + 0.6 * k for k in range(n)):
        hold += [(at_s, 1.0), (at_s + 0.001, 0.0), (at_s + 0.3, 0.0), (at_s + 0.301, 1.0)]
        jaw += [(at_s, 0.2), (at_s + 0.001, 0.6), (at_s + 0.3, 0.6), (at_s + 0.301, 0.2)]
    return {"hold": [*hold, *GOOD["hold"][2:]], "jaw": [*jaw, *GOOD["jaw"]]}


case("E13", "regrasps", grasps(7), grasps(6))
by_value("E14", "counter-traction", "traction", 0.01, 1.5, duct_squeeze=[(0.0, 1e-6)])


def judged(
    changes: dict[str, Channel], seconds: float = 16.0, scenario: Scenario = SCENARIO
) -> tuple[Judge, list[ErrorEvent]]:
    judge = Judge(scenario, SITE)
    for topic, time_ns, body in messages(changed(changes), seconds):
        judge.take_frame(topic, time_ns, body)
    return judge, judge.log.events


def until_s(changes: dict[str, Channel]) -> float:
    """As long as it takes: a second after the last change of a channel that is not as in the good attempt."""
    new = [at_s for name, points in changes.items() for at_s, value in points if (at_s, value) not in GOOD[name]]
    return max(new, default=15.0) + 1.2


def test_a_good_attempt_goes_through_all_phases_without_an_error() -> None:
    judge, errors = judged({})
    assert errors == []
    assert judge.procedure.order == ("P0", "P1", "P2", "P3", "P4", "P5", "P6", "P7")
    begins = {span.phase: span.begin_s for span in judge.procedure.spans}
    assert begins["P2"] == pytest.approx(0.3, abs=0.01)
    assert begins["P4"] == pytest.approx(2.5 + 5.5 * 2 / 15, abs=0.01)
    assert begins["P6"] == pytest.approx(12.0, abs=0.01)


def test_every_row_has_a_case_and_every_error_a_row() -> None:
    assert set(CASES) == {(rule.code, rule.name) for rule in RULES}
    assert list(ERRORS) == [f"E{k}" for k in range(1, 15)]
    assert {rule.code for rule in RULES} == set(ERRORS)


@pytest.mark.parametrize(("code", "name"), CASES)
def test_hands_that_err_are_caught_by_this_row_alone(code: str, name: str) -> None:
    changes = CASES[code, name][0]
    _, errors = judged(changes, until_s(changes))
    assert {(error.code, error.evidence) for error in errors} == {(code, name)}
    (rule,) = (rule for rule in RULES if rule.name == name)
    for error in errors:
        assert error.worst < error.limit if rule.below else error.worst > error.limit
        assert 0.0 <= error.begin_s <= error.end_s <= until_s(changes)


@pytest.mark.parametrize(("code", "name"), CASES)
def test_a_near_miss_is_no_error(code: str, name: str) -> None:
    changes = CASES[code, name][1]
    _, errors = judged(changes, until_s(changes))
    assert errors == []


#: What is counted, or adds up in steps of the judge's situations, of 20 ms, meets no nearer limit than the next.
_IN_STEPS = {"regrasps": 1.0, "air_s": 0.015, "dropped_s": 0.05}


@pytest.mark.parametrize("by", [-1.0, 1.0])
@pytest.mark.parametrize(("code", "name"), [key for key in CASES if key != ("E13", "lost from closed jaws")])
def test_a_limit_that_is_moved_by_a_little_is_noticed(code: str, name: str, by: float) -> None:
    """Moved one way it makes the near miss an error, moved the other way the error none; a loss is one or is not."""
    (rule,) = (rule for rule in RULES if rule.name == name)
    limit = SCENARIO.limit(rule.limit)
    step = _IN_STEPS.get(rule.limit, 0.08 * limit or 0.08)
    moved = replace(SCENARIO, limits={rule.limit: Limit(value=limit + by * step)})
    changes = CASES[code, name][0 if rule.below is (by < 0.0) else 1]
    _, errors = judged(changes, until_s(changes), moved)
    is_told = name in {error.evidence for error in errors}
    assert is_told is (rule.below is (by > 0.0))


@pytest.mark.parametrize("begin_tick", [0, 7000, 12_345, 59_999])
@pytest.mark.parametrize(("name", "evidence"), [("load on the rim", "rim_n"), ("force at the tip", "tip_n")])
def test_evidence_that_stands_exactly_as_long_as_its_rule_says_is_an_error(
    name: str, evidence: str, begin_tick: int
) -> None:
    """And a tick less is none, whatever the rounding of times."""
    (rule,) = (rule for rule in RULES if rule.name == name)
    beyond = {evidence: 1.5 * SCENARIO.limit(rule.limit)}
    for ticks, n_errors in ((round(rule.for_s / TICK_S), 1), (round(rule.for_s / TICK_S) - 1, 0)):
        log, procedure = ErrorLog(SCENARIO), Procedure(SCENARIO)
        for tick in (begin_tick, begin_tick + ticks):
            procedure.time_s = tick * TICK_S
            log.take_situation(Situation(tick, [], np.zeros(3), 15e-3, **beyond), procedure)
        assert len(log.events) == n_errors


@pytest.mark.parametrize(("short_m", "retries"), [(0.45e-3, 1), (0.55e-3, 0)])
def test_a_retry_begins_when_the_tip_is_back_within_half_a_millimetre(short_m: float, retries: int) -> None:
    """It was 1 mm before the mouth, is drawn back by 2.5 mm more, and comes back to just so far from its best place."""
    back = [(1.0, 6e-3), (2.0, 1e-3), (2.1, 1e-3), (2.2, 3.5e-3), (2.3, 1e-3 + short_m)]
    judge, errors = judged({"gap": back, "inserted": [(0.0, 0.0)]}, 3.0)
    assert judge.procedure.retries == retries
    assert [error.evidence for error in errors if error.code == "E3"] == ["withdrawal before a retry"] * retries
