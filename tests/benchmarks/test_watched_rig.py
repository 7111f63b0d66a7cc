"""The judge of the benchmarks: alarms are true where the counts of the loop that they name show what they say."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

MISSES = 'trocar_deadline_misses_total{loop="physics"}'
SAID = "supervisor: degraded: physics: 62 ticks lost in the last minute, budget 60"


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    import watched_rig

    yield watched_rig
    for name in ("watched_rig", "report"):
        sys.modules.pop(name, None)


def history(watched: Any, *, before: int, at_once: int, later: int) -> Any:
    """Return one sample a second of a rig that runs from the fifth on, and is watched from the seventh."""
    samples = []
    for t in range(40):
        lost = before * (t >= 2) + at_once * (t >= 6) + later * (t >= 20)
        counts = {MISSES: float(lost), f'trocar_rig_state{{state="{"running" if t >= 5 else "starting"}"}}': 1.0}
        samples.append(watched.Sample(float(t), counts, 0))
    made = watched.History(samples[:7])
    made.samples = samples[7:]
    return made


def test_ticks_lost_between_running_and_the_first_look_are_counted(watched: Any) -> None:
    """A rig is noisy in its first second: six alarms of one run were called false that it had good reason for."""
    assert history(watched, before=0, at_once=40, later=22).is_true(SAID, 25.0)


@pytest.mark.parametrize(("before", "at_once", "later"), [(500, 40, 0), (0, 0, 59), (500, 0, 0)])
def test_an_alarm_that_counts_what_was_lost_before_the_rig_ran_is_false(
    watched: Any, before: int, at_once: int, later: int
) -> None:
    assert not history(watched, before=before, at_once=at_once, later=later).is_true(SAID, 25.0)


@pytest.mark.parametrize(("rate_hz", "true"), [(1000.0, False), (998.0, True)])
def test_a_loop_that_waits_for_another_loses_ticks_that_it_does_not_miss(
    watched: Any, rate_hz: float, true: bool
) -> None:
    """Haptics ran at 998 Hz behind a gateway that was held up: each of its own ticks came in time."""
    samples = [
        watched.Sample(
            float(t),
            {
                'trocar_loop_iterations_total{loop="haptics"}': rate_hz * t,
                'trocar_service_uptime_seconds{service="haptics"}': float(t),
                'trocar_rig_state{state="running"}': 1.0,
            },
            0,
        )
        for t in range(80)
    ]
    made = watched.History([])
    made.samples = samples
    assert made.is_true("supervisor: degraded: haptics: 86 ticks lost in the last minute, budget 60", 70.0) == true
