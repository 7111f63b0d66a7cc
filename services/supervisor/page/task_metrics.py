"""Metrics of the task from the training's reports: depth of the catheter, errors, and outcomes of attempts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

import trocar.protocol.bodies as bodies
from trocar.services.training.errors import ERRORS

_STATES = ("armed", "running", "done", "abandoned")
_OUTCOMES = ("success", "failure", "abandoned")


def _phase(attempt: bodies.Attempt) -> float:
    """Return the number of a phase P0 to P7; 0 before the first."""
    digits = attempt.phase.removeprefix("P")
    return float(digits) if digits.isdigit() else 0.0


_GAUGES: dict[str, tuple[str, Callable[[bodies.Attempt], float]]] = {
    "trocar_attempt_phase": ("Phase of the procedure, 0 to 7", _phase),
    "trocar_attempt_inserted_metres": ("Length of the catheter in the lumen", lambda now: now.depth_m),
    "trocar_attempt_goal_metres": ("Length to be inserted, 0 without a goal", lambda now: now.goal_depth_m),
    "trocar_attempt_seconds": ("Simulated time since the first motion", lambda now: now.time_s),
    "trocar_attempt_force_limit_newtons": ("Limit of force on the duct, 0 for none", lambda now: now.force_limit_n),
}


@dataclass(slots=True)
class Task:
    """Attempts of a rig: the newest report, outcomes, and errors by code."""

    attempt: bodies.Attempt | None = None
    ended: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)

    def see(self, attempt: bodies.Attempt) -> None:
        """Add a report. Some may be missed, so an attempt that ran and has vanished counts as abandoned."""
        last, self.attempt = self.attempt, attempt
        is_same = last is not None and last.attempt_id == attempt.attempt_id
        before = last.errors if last is not None and is_same else {}
        self.errors.update({code: max(0, attempt.errors.get(code, 0) - before.get(code, 0)) for code in ERRORS})
        if last is None or last.state != "running":
            return
        if not is_same or attempt.state == "abandoned":
            self.ended["abandoned"] += 1
        elif attempt.state == "done" and attempt.outcome in _OUTCOMES:
            self.ended[attempt.outcome] += 1


def families(task: Task) -> Iterator[Metric]:
    """Yield the families; those of the present attempt are empty without a training process."""
    now = task.attempt
    state = GaugeMetricFamily("trocar_attempt_state", "1 for the state that the attempt is in", labels=["state"])
    for name in _STATES if now is not None else ():
        state.add_metric([name], float(now is not None and now.state == name))
    yield state
    for name, (text, look) in _GAUGES.items():
        told = {"labels": ()} if now is None else {"value": look(now)}
        yield GaugeMetricFamily(name, text, **told)
    ended = CounterMetricFamily("trocar_attempts", "Attempts that ended", labels=["outcome"])
    for outcome in _OUTCOMES:
        ended.add_metric([outcome], task.ended[outcome])
    text = "Errors of trainees by code; E1 is force on the duct above its limit"
    errors = CounterMetricFamily("trocar_attempt_errors", text, labels=["code"])
    for code in ERRORS:
        errors.add_metric([code], task.errors[code])
    yield from (ended, errors)
