"""The attempts of a session: starts them, executes orders, and reports their state."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence

from trocar.protocol import bodies
from trocar.protocol.topics import ORDER_S
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.training.attempt import AttemptState, FollowedAttempt
from trocar.services.training.fitness import Fitness
from trocar.services.training.hints import hint
from trocar.services.training.judge import Judge
from trocar.services.training.rig_observer import RigObserver
from trocar.services.training.scenario import Scenario
from trocar.services.training.score import ScoreRules, score_of

#: Slowest motion that can be asked for: a tick then takes as long as two pictures at 60 Hz, so that each is seen.
SLOWEST = 1.0 / 32.0
#: How long a device's button must be pressed to restart the scene: longer than any press by which tissue is held or
#: flushed by mistake, as an attempt is lost by it. An assumption.
PRESSED_S = 2.0
NO_SCORE = -1.0  # no score is below 0
#: Answers that are repeated: an order lives `ORDER_S`, and nobody presses more than four buttons in one second. Orders
#: are known for four times as long, so that none that is repeated is carried out again.
_KEPT = 8
_MOST_STEPS = 1000  # a second, as long as slow motion is the better way for more


class Trainer:
    """The logic of the training process, without bus and clock.

    Args:
        scenario: The scenario of the attempts; None for practice without a goal.
        again_after_s: Time after a success until the next attempt starts automatically; None for never.
        spared: As in `RigObserver`.
        judges: Returns a new judge of phases and errors for each attempt when it starts; None for no judging.
        rules: Rules for scoring completed attempts; None for no score.
        ways: Paths through the duct, for a branch as the goal.
        simulated: Whether the rig's time is simulated.
        never_counts: Why no attempt of this rig counts; empty if one may.
    """

    def __init__(
        self,
        scenario: Scenario | None,
        again_after_s: float | None = None,
        spared: Collection[str] = (),
        judges: Callable[[Scenario], Judge] | None = None,
        rules: ScoreRules | None = None,
        ways: TubePaths | None = None,
        *,
        simulated: bool = False,
        never_counts: str = "",
    ) -> None:
        self.scenario, self._never_counts = scenario, never_counts
        self.fitness = Fitness(simulated=simulated)
        self.observer = RigObserver(spared, ways, scenario.goal.branch if scenario else "", self.fitness)
        self.attempt = self._new_attempt()
        self._id = _new_id()
        self._again_after_s, self._judges, self._rules = again_after_s, judges, rules
        self._begins = self._awaited = self._asked = self._steps = 0
        self._pace, self.score = 1.0, NO_SCORE
        self.examines = False
        self._from_tick = self._until_tick = -1
        self._ended_s: float | None = None
        self._parting: bodies.Attempt | None = None
        self._answers: deque[bodies.Answer] = deque(maxlen=_KEPT)
        self._seen: deque[int] = deque(maxlen=4 * _KEPT)

    def follow_attempt(self, now_s: float) -> None:
        """Update the attempt after new frames, and start the next one if due."""
        if self.observer.begins < self._awaited and self.observer.gateway == self._asked:
            return  # the gateway restarts the scene as soon as no arm bears a force
        self._awaited = 0
        seen = self.observer.observe()
        if seen is not None:
            self.attempt.observe(seen)
        self.fitness.take_tick(now_s, self.observer.tick, self._pace)
        runs = self.attempt.state is AttemptState.RUNNING
        if runs and self._from_tick < 0:
            self._from_tick = self.observer.tick + 1
        if runs and self.observer.judge is None and self._judges is not None and self.scenario is not None:
            self.observer.judge = self._judges(self.scenario)
        if self._from_tick >= 0 and self._ended_s is None:
            self._until_tick = self.observer.tick
        if self.attempt.ended and self._ended_s is None:
            self._ended_s, self.score = now_s, self._total()
        if self.observer.pressed_s >= PRESSED_S:
            self.observer.release()
            self.begin_attempt("somebody pressed the button of a device")
        due = self._again_after_s is not None and self.attempt.outcome == "success"
        if due and self._ended_s is not None and now_s - self._ended_s >= (self._again_after_s or 0.0):
            self.begin_attempt("")

    def _total(self) -> float:
        """Judge the end of a completed attempt, and return its total."""
        judge, attempt = self.observer.judge, self.attempt
        if judge is None or self.scenario is None or self._rules is None:
            return NO_SCORE
        judge.finish()
        attempt.errors = judge.errors
        score = score_of(self.scenario, self._rules, attempt.outcome, attempt.time_s, judge.events, {})
        return NO_SCORE if score is None else score.total

    def begin_attempt(self, why: str) -> str:
        """Abandon a present attempt, and restart the scene."""
        if not self.attempt.ended:
            self.attempt.abandon(why)
            self._parting = self.body()
        self._begins += 1
        self._awaited, self._asked = self.observer.begins + 1, self.observer.gateway
        self._pace, self.score = 1.0, NO_SCORE
        self._ended_s = self.observer.judge = None
        self._from_tick = self._until_tick = -1
        self.attempt, self._id = self._new_attempt(), _new_id()
        return "a new attempt begins"

    def _new_attempt(self) -> FollowedAttempt:
        attempt = FollowedAttempt(self.scenario.goal if self.scenario else None)
        if self._never_counts:
            attempt.spoil(self._never_counts)
        return attempt

    def obey(self, orders: Sequence[bodies.Order]) -> None:
        """Execute orders, each once, unless too old."""
        for order in orders:
            if order.id in self._seen:
                continue
            self._seen.append(order.id)
            ok, text = (False, "came too late") if order.age_s > ORDER_S else self._carry_out(order)
            self._answers.append(bodies.Answer(order=order.id, ok=ok, text=text))

    def _carry_out(self, order: bodies.Order) -> tuple[bool, str]:
        match order.what:
            case "new":
                return True, self.begin_attempt("a new one was asked for")
            case "pause":
                self._pace = 0.0
                return True, "paused: arms are limp"
            case "resume":
                self._pace = 1.0
                return True, "time goes on; force comes back within a second"
            case "slow" if SLOWEST <= order.value <= 1.0:
                self._pace = order.value
                if order.value < 1.0:
                    self.attempt.spoil("slow motion was used")
                return True, f"time goes at {order.value:g} of the clock"
            case "slow":
                return False, f"slow motion goes from 1/32 to 1, not {order.value:g}"
            case "step" if self._pace == 0.0 and order.value in range(1, _MOST_STEPS + 1):
                self._steps += int(order.value)
                self.attempt.spoil("it was stepped through")
                return True, f"{int(order.value)} ms on"
            case "step":
                return False, f"single steps, whole ms from 1 to {_MOST_STEPS}, are taken while paused"
            case "examine":
                self.examines = order.value > 0.0
                if not self.attempt.ended and self.attempt.state is AttemptState.RUNNING:
                    self.attempt.spoil("whether help is given was changed while it ran")
                return True, "from now on nobody helps" if self.examines else "from now on help is given"
            case "bookmark":
                self.attempt.bookmark()
                return True, f"marked at {self.attempt.time_s:.1f} s"
        return False, f"there is no order {order.what!r}"

    def tell(self) -> bodies.Attempt:
        """Return the next message: first the last state of an abandoned attempt, then the present one."""
        parting, self._parting = self._parting, None
        return parting or self.body()

    def body(self) -> bodies.Attempt:
        """Return the present state for publishing."""
        attempt, scenario = self.attempt, self.scenario
        goal = scenario.goal if scenario else None
        helps = not self.examines or attempt.ended
        return bodies.Attempt(
            begins=self._begins,
            pace=self._pace,
            steps=self._steps,
            attempt_id=self._id,
            state=attempt.state.value,
            outcome=attempt.outcome,
            reason=attempt.reason[:256],
            scenario=scenario.name if scenario else "",
            title=scenario.title if scenario else "Practice without a goal",
            began_tick=attempt.began_tick,
            time_s=attempt.time_s,
            time_limit_s=goal.time_limit_s if goal else 0.0,
            phase=attempt.phase,
            depth_m=attempt.depth_m,
            goal_depth_m=goal.depth_m if goal else 0.0,
            depth_max_m=scenario.limit("depth_max_m") if scenario else 0.0,
            force_limit_n=scenario.limit("tool_duct_force_n") if scenario else 0.0,
            errors=dict(attempt.errors) if helps else {},
            counts=not attempt.why_not,
            why_not=attempt.why_not,
            held=self.observer.held,
            hint=hint(attempt, self.observer, scenario) if helps else "",
            examined=self.examines,
            mirrored=scenario.view.mirrored if scenario else False,
            one_handed=scenario.view.one_handed if scenario else False,
            bookmarks_s=tuple(attempt.bookmarks_s[-64:]),
            answers=tuple(self._answers),
            score=self.score,
            from_tick=self._from_tick,
            until_tick=self._until_tick,
            simulated_time=self.fitness.simulated,
            speed=round(self.fitness.speed, 3),
            practice_only=self.fitness.practice_only,
        )

    def gist(self) -> tuple[object, ...]:
        """Return the values whose change is published at once."""
        attempt, answered = self.attempt, self._answers[-1].order if self._answers else 0
        parts = self._parting is not None
        only = self.fitness.practice_only
        return parts, self._id, attempt.state, attempt.why_not, self._pace, self._steps, answered, only


def _new_id() -> str:
    return f"{time.strftime('%Y%m%dT%H%M%S', time.gmtime())}-{secrets.token_hex(3)}"
