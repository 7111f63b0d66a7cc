"""The order of enforcement: quality, restart, safe stop; and the way back."""

from __future__ import annotations

from dataclasses import replace

from trocar.services.runtime.loop.quality_governor import Hysteresis
from trocar.services.supervisor.judge.contracts import Breach
from trocar.services.supervisor.judge.enforcement import Action, ActionKind, Enforcement, Ladder
from trocar.services.supervisor.judge.governor import Level

LEVELS = tuple(Level(name) for name in ("full", "fewer", "fewest"))

SLIGHT = Breach("haptics", "path", "device_model slow", 2.0, False)
SEVERE = Breach("physics", "rate", "physics slow", 3.0, True)


def _climb(enforcement: Enforcement, standing: list[Breach], seconds: float, start_s: float = 0.0) -> list[Action]:
    actions = []
    for step in range(round(seconds / 0.1)):
        action = enforcement.decide(start_s + step * 0.1, standing)
        if action is not None:
            actions.append(action)
    return actions


def test_severe_breach_climbs_every_rung_in_order() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:3], patience_s=1.0))
    actions = _climb(enforcement, [SEVERE], 6.0)
    assert [action.kind for action in actions] == [
        ActionKind.LOWER, ActionKind.LOWER, ActionKind.RESTART, ActionKind.SAFE_STOP, ActionKind.SAFE_STOP,
    ]  # fmt: skip
    assert actions[2].process == "physics"
    assert enforcement.level == 2


def test_slight_breach_stays_on_the_last_level() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:2], patience_s=1.0))
    assert [action.kind for action in _climb(enforcement, [SLIGHT], 30.0)] == [ActionKind.LOWER]


def test_each_rung_waits_its_patience() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:3], patience_s=1.0))
    assert _climb(enforcement, [SEVERE], 1.0) == []
    assert len(_climb(enforcement, [SEVERE], 1.0, 1.0)) == 1
    assert _climb(enforcement, [], 0.1, 2.0) == []  # gone: the next breach waits anew
    assert _climb(enforcement, [SEVERE], 1.0, 2.1) == []


def test_where_nobody_may_restart_the_rung_is_skipped() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:1], patience_s=1.0, may_restart=False))
    assert _climb(enforcement, [SEVERE], 1.2)[0].kind is ActionKind.SAFE_STOP


def test_the_severe_one_is_acted_on_even_if_another_is_further_over_its_limit() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:1], patience_s=1.0))
    far = Breach("haptics", "path", "far over", 50.0, False)
    assert _climb(enforcement, [far, SEVERE], 1.2)[0].process == "physics"


def test_quality_returns_after_calm_and_later_after_a_failed_try() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:2], patience_s=1.0, hysteresis=Hysteresis(calm_s=5.0)))
    _climb(enforcement, [SLIGHT], 1.5)
    (up,) = _climb(enforcement, [], 5.5, 2.0)
    assert (up.kind, enforcement.level) == (ActionKind.RAISE, 0)
    _climb(enforcement, [SLIGHT], 1.5, 8.0)
    assert enforcement.level == 1
    assert _climb(enforcement, [], 9.5, 10.0) == []
    assert [action.kind for action in _climb(enforcement, [], 1.0, 19.6)] == [ActionKind.RAISE]


def test_arming_allows_a_restart_again() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:1], patience_s=1.0))
    assert [action.kind for action in _climb(enforcement, [SEVERE], 2.2)] == [ActionKind.RESTART, ActionKind.SAFE_STOP]
    enforcement.reset()
    assert _climb(enforcement, [SEVERE], 1.2, 10.0)[0].kind is ActionKind.RESTART


def _both(
    enforcement: Enforcement, start_s: float, seconds: float, severe_from_s: float, severe_s: float
) -> list[Action]:
    """A slight breach that stands all the time, severe in the middle of it."""
    actions = []
    for step in range(round(seconds / 0.1)):
        now_s = start_s + 0.1 * step
        is_severe = severe_from_s <= now_s < severe_from_s + severe_s
        action = enforcement.decide(now_s, [SEVERE if is_severe else replace(SEVERE, severe=False)])
        if action is not None:
            actions.append(action)
    return actions


def test_a_moment_of_severity_on_top_of_what_stands_restarts_nobody_whenever_it_comes() -> None:
    for severe_from_s in (0.0, 3.0, 4.6, 9.3, 14.8):
        enforcement = Enforcement(Ladder(levels=LEVELS[:1]))
        assert _both(enforcement, 0.0, 40.0, severe_from_s, 2.0) == []


def test_severity_that_stands_restarts_though_a_window_now_and_then_is_not_severe() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS[:1], patience_s=1.0))
    slight = replace(SEVERE, severe=False)
    actions = [enforcement.decide(0.1 * step, [slight if step % 5 == 3 else SEVERE]) for step in range(40)]
    assert ActionKind.RESTART in [action.kind for action in actions if action is not None]


def test_quality_is_not_given_up_for_what_less_work_would_not_have_spared() -> None:
    """One stall of the host of 49 ms lowered the quality of a rig that had time enough."""
    for by_work in (False, True):
        breach = Breach("physics", "physics ticks", "ticks lost", 2.0, severe=False, sudden=True, by_work=by_work)
        made = Enforcement(Ladder(levels=(Level("full"), Level("less")), patience_s=5.0))
        acts = [act for k in range(200) if (act := made.decide(0.1 * k, [breach])) is not None]
        assert [act.kind for act in acts[:1]] == [ActionKind.LOWER] * by_work
        assert made.level == int(by_work)
    severe = Breach("physics", "physics ticks", "ticks lost", 9.0, severe=True, sudden=True, by_work=False)
    made = Enforcement(Ladder(levels=(Level("full"), Level("less")), patience_s=5.0))
    kinds = [act.kind for k in range(200) if (act := made.decide(0.1 * k, [severe])) is not None]
    assert kinds[:2] == [ActionKind.RESTART, ActionKind.SAFE_STOP], "hands that are not served are let go all the same"
