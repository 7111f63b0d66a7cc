"""A recording, or any stream of frames, to the assessments of the attempts in it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import msgspec
import numpy as np

from trocar.protocol.bodies import GatewayState, PhysicsState, SupervisorState
from trocar.protocol.bodies.training import Attempt
from trocar.protocol.topics import MOMENT_TICKS, TICK_S
from trocar.review.attempts.assessment import FAULTS_ABOVE, Assessment, RigQuality, series_of
from trocar.review.attempts.experts import counts_of
from trocar.review.attempts.faults import FaultLog
from trocar.review.attempts.metrics import TISSUE_LIMITS, metrics_of
from trocar.review.attempts.trace import Trace
from trocar.services.runtime.errors import UserError
from trocar.services.training.judge import Judge
from trocar.services.training.scenario import Scenario
from trocar.services.training.score import Band, ScoreRules, score_of
from trocar.services.training.site import Site
from trocar.services.training.situation import TISSUES

Message = tuple[str, int, msgspec.Struct]
TOPICS = ("gateway.state", "haptics.contacts", "physics.state", "supervisor.state", "training.attempt")
VERSION = "1"
"""Of what is measured: it changes where the same recording would be judged otherwise."""
#: Physics is recorded at 25 Hz at least; with longer gaps something may have happened unseen.
_LARGEST_GAP_S = 0.5
_LONGEST_S = 86_400.0  # a day: no attempt lasts as long, so that its times are no times
_LATE = ("degraded", "safe_stop")
#: A recording begins some moments before the first word of `training.attempt`, ten a second: they are no attempt. Five
#: seconds are an assumption.
_HEAD_S = 5.0
#: For so long an attempt may have gone on before it is told of: twice as long as its last report counts as fresh.
_BEFORE_NS = 2_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """By what attempts are judged. Scenario and experts are asked for by the name that an attempt has."""

    scenario_of: Callable[[str], Scenario]
    rules: ScoreRules
    band_of: Callable[[str], Band] = lambda _: {}
    site: Site | None = None


def assess(messages: Iterable[Message], terms: Terms, source: str = "") -> Iterator[Assessment]:
    """Yield the attempts of a stream in which somebody moved, each when it has ended; the last may be incomplete.

    Without a word of `training.attempt` the whole stream is one attempt at the scenario without a name, and so is what
    goes on for more than some seconds before the first word.
    Raises UserError naming the source, if ticks jump by more than a day.
    """
    running: _Running | None = None
    told = False
    first_ns: int | None = None
    before: deque[Message] = deque()
    for topic, time_ns, body in messages:
        before.append((topic, time_ns, body))
        while time_ns - before[0][1] > _BEFORE_NS:
            before.popleft()
        first_ns = time_ns if first_ns is None and isinstance(body, GatewayState) else first_ns
        if isinstance(body, Attempt):
            if not told and running is not None and running.time_s < _HEAD_S:
                running = None
            told = True
            if running is not None and (body.attempt_id != running.attempt_id or body.state != "running"):
                yield running.end(body)
                running = None
            if running is None and body.state == "running":
                running = _Running(terms, source, (time_ns, time_ns - (first_ns or time_ns)), body)
                running.take_earlier(before)
        elif running is None and not told and isinstance(body, GatewayState):
            running = _Running(terms, source, (time_ns, 0), None)
        if running is not None:
            running.take_frame(topic, time_ns, body)
    if running is not None:
        yield running.end(None)


class _Running:
    """An attempt that goes on."""

    def __init__(self, terms: Terms, source: str, began_ns: tuple[int, int], told: Attempt | None) -> None:
        self.attempt_id = told.attempt_id if told else ""
        self._terms, self._source, self._began_ns, self._told = terms, source, began_ns, told
        self._scenario = terms.scenario_of(told.scenario if told else "")
        self._judge = Judge(self._scenario, terms.site)
        self._trace = Trace()
        self._rig = _RigWatch()
        self._waiting: list[Message] = []
        self._slowest = 1.0

    @property
    def time_s(self) -> float:
        """For how long it goes on."""
        return self._judge.procedure.time_s

    def take_earlier(self, messages: Iterable[Message]) -> None:
        """Take those messages from before it was told that belong to it: from the first tick on that is judged."""
        if self._told is not None and self._told.from_tick >= 0:
            self._waiting += [each for each in messages if getattr(each[2], "tick", -1) >= self._told.from_tick]

    def take_frame(self, topic: str, time_ns: int, body: msgspec.Struct) -> None:
        """Take a frame of any topic; those of the loops wait until it is told that they are judged."""
        if isinstance(body, Attempt):
            self._told = body
            self._slowest = min(self._slowest, body.speed)
            self._take_waiting(body.until_tick if body.until_tick >= 0 else None)
        elif isinstance(body, SupervisorState):
            self._rig.take_word(body, is_felt=self._told is None or not self._told.simulated_time)
        elif self._told is not None and self._told.from_tick >= 0:
            self._waiting.append((topic, time_ns, body))
        else:
            self._judge_frame(topic, time_ns, body)

    def _take_waiting(self, until_tick: int | None) -> None:
        """Judge the frames up to a tick, or all."""
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            if until_tick is None or getattr(each[2], "tick", -1) <= until_tick:
                self._judge_frame(*each)
            else:
                self._waiting.append(each)

    def _judge_frame(self, topic: str, time_ns: int, body: msgspec.Struct) -> None:
        if isinstance(body, GatewayState):
            if self._told is not None and self._told.simulated_time:  # no tick is lost, and moments tell the motion
                if body.tick % MOMENT_TICKS == 0:
                    self._trace.take_devices(body)
            else:
                self._rig.take_devices(body)
                self._trace.take_devices(body)
        elif isinstance(body, PhysicsState):
            self._rig.take_physics(body)
        situation = self._judge.take_frame(topic, time_ns, body)
        if situation is not None:
            self._trace.take_situation(situation, self._judge.procedure)

    def end(self, told: Attempt | None) -> Assessment:
        """Return what is known; `told` is the word that ended it, None where the stream did."""
        ended = told if told is not None and told.attempt_id == self.attempt_id else None
        self._take_waiting(ended.until_tick if ended is not None and ended.until_tick >= 0 else None)
        last = ended or self._told
        outcome = "incomplete" if told is None else "abandoned"
        if ended is not None and ended.state == "done":
            outcome = ended.outcome or "failure"
            self._judge.finish()
        return self._assessment(outcome, last)

    def _assessment(self, outcome: str, told: Attempt | None) -> Assessment:
        scenario, procedure, terms = self._scenario, self._judge.procedure, self._terms
        columns, errors = self._trace.columns(), self._judge.log.events
        if max([0.0, *columns.time_s[-1:], *columns.way_s[-1:]]) > _LONGEST_S:
            raise UserError(f"{self._source}: an attempt of more than a day: the ticks in it cannot be right")
        metrics = metrics_of(columns, procedure, scenario) | counts_of(errors)
        if told is not None:
            metrics["time_s"] = told.time_s if outcome in ("success", "failure") else procedure.time_s
        score = score_of(scenario, terms.rules, outcome, metrics["time_s"], errors, terms.band_of(scenario.name))
        if score is not None:
            metrics["total"] = score.total
        rig = self._rig.quality(has_force=self._trace.has_force)
        return Assessment(
            attempt_id=self.attempt_id,
            scenario=scenario.name,
            title=scenario.title,
            outcome=outcome,
            reason=told.reason if told else "",
            source=self._source,
            began_ns=self._began_ns[0],
            began_at_s=1e-9 * self._began_ns[1],
            version=VERSION,
            why_not=self._why_not(told, rig),
            time_s=metrics["time_s"],
            time_limit_s=scenario.goal.time_limit_s,
            goal_depth_m=scenario.goal.depth_m,
            depth_max_m=scenario.limit("depth_max_m"),
            phases=procedure.spans,
            errors=errors,
            metrics=dict(sorted(metrics.items())),
            limits={tissue: scenario.limit(name) for tissue, name in TISSUE_LIMITS.items()},
            score=score,
            rig=rig,
            bookmarks_s=told.bookmarks_s if told else (),
            par=dict(scenario.par),
            not_judged=self._not_judged(),
            series=series_of(columns, TISSUES),
            from_tick=told.from_tick if told else -1,
            simulated_time=told.simulated_time if told else False,
            slowest=self._slowest,
            examined=told.examined if told else False,
        )

    def _why_not(self, told: Attempt | None, rig: RigQuality) -> tuple[str, ...]:
        why = [told.why_not or "the rig says so"] if told is not None and not told.counts else []
        if rig.faults:
            more = len(rig.faults) - FAULTS_ABOVE
            said = [*rig.faults[:FAULTS_ABOVE], *([f"and {more} more"] if more > 0 else [])]
            why.append(f"the rig broke its contracts: {'; '.join(said)}")
        if rig.largest_gap_s > _LARGEST_GAP_S:
            why.append(f"the recording has a gap of {rig.largest_gap_s:.1f} s")
        return tuple(why)

    def _not_judged(self) -> tuple[str, ...]:
        site = self._terms.site
        lacking = {"E2: area of the opening": site is not None and bool(site.rim_gain), "E11": site is not None}
        lacking["E12: view"] = site is not None and site.eye_m is not None
        lacking["E14"] = not self._scenario.view.one_handed
        return tuple(name for name, known in lacking.items() if not known)


class _RigWatch:
    """Ticks that are missing, and what the supervisor says."""

    def __init__(self) -> None:
        self._ticks = self._lost = self._gap = 0
        self._last_tick: int | None = None
        self._last_step: int | None = None
        self._ages_s: list[float] = []
        self._level = 0
        self._faults = FaultLog()

    def take_word(self, body: SupervisorState, *, is_felt: bool) -> None:
        """Take what the supervisor says; nobody feels late ticks in simulated time, which loses none."""
        self._level = max(self._level, body.quality_level)
        is_stopped = body.state == "safe_stop" or (body.safe_stop and body.state != "off")
        is_at_fault = is_stopped or (is_felt and body.state in _LATE)
        self._faults.take_sentence((body.reason or body.state) if is_at_fault else "")

    def take_devices(self, body: GatewayState) -> None:
        if self._last_tick is not None and body.tick > self._last_tick:
            self._ticks += body.tick - self._last_tick
            self._lost += body.tick - self._last_tick - 1
        self._last_tick = body.tick
        self._ages_s.extend(each.model_age_s for each in body.instruments if each.model_age_s >= 0.0)

    def take_physics(self, body: PhysicsState) -> None:
        if self._last_step is not None:
            self._gap = max(self._gap, body.tick - self._last_step)
        self._last_step = body.tick

    def quality(self, *, has_force: bool) -> RigQuality:
        return RigQuality(
            lost_ticks=self._lost / self._ticks if self._ticks else 0.0,
            largest_gap_s=self._gap * TICK_S,
            model_age_ms=1e3 * float(np.quantile(self._ages_s, 0.99)) if self._ages_s else None,
            lowest_quality_level=self._level,
            has_force=has_force,
            faults=self._faults.sentences(),
        )
