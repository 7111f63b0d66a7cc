"""Orders to the attempt, what is told of it, and what the bus says of it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import msgspec
import numpy as np
import pytest

from tests.protocol import samples
from trocar.protocol import Frame, bodies
from trocar.protocol.arrays import pack
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.config.config import load_rig
from trocar.services.runtime.errors import ConfigError
from trocar.services.training import __main__ as training_process
from trocar.services.training.errors import ErrorEvent
from trocar.services.training.hints import hint
from trocar.services.training.scenario import Goal, Scenario
from trocar.services.training.score import load_rules
from trocar.services.training.site import Site
from trocar.services.training.trainer import Trainer

SCENARIO = Scenario(
    name="basic", title="Slide it in", scene="default", goal=Goal(depth_m=0.01, hold_s=0.5), hint="Grasp it."
)


class Rig:
    """Says what gateway, haptics and physics would; begins again where it is told to, unless it is `deaf`."""

    def __init__(self, trainer: Trainer) -> None:
        self.trainer = trainer
        self.tick = self.begins = 0
        self.depth_m, self.y_m, self.buttons, self.force_n = 0.0, 0.0, 0, 0.0
        self.now_ns, self.incarnation, self.kind = 0, 1, 0
        self.deaf = False
        self._told = 0

    def turn(self, ticks: int = 100) -> bodies.Attempt:
        """Let time go on, and return what is told then."""
        self.tick += ticks
        self.now_ns += 100_000_000
        left = bodies.InstrumentState(name="left", position_m=(0.0, self.y_m, 0.0), buttons=self.buttons)
        gateway = bodies.GatewayState(tick=self.tick, instruments=(left,), begins=self.begins)
        contacts = samples._contacts()
        hold = msgspec.structs.replace(contacts.holds[0], target_kind=self.kind)
        contacts = msgspec.structs.replace(contacts, holds=(hold,))
        physics = samples.physics_state(self.tick, bodies.ToolReaction(force_n=(self.force_n, 0.0, 0.0)))
        rod = msgspec.structs.replace(physics.catheter, inserted_length_m=self.depth_m)
        physics = msgspec.structs.replace(physics, catheter=rod)
        said = {"gateway.state": gateway, "haptics.contacts": contacts, "physics.state": physics}
        frames = {name: Frame(1, name, 1, self.incarnation, 0, 0, 0, True, body) for name, body in said.items()}
        self.trainer.observer.take_frames(frames, self.now_ns)
        self.trainer.follow_attempt(self.now_ns * 1e-9)
        told = self.trainer.body()
        if told.begins > self._told and not self.deaf:
            self.begins, self._told = self.begins + told.begins - self._told, told.begins
            self.depth_m = self.y_m = 0.0
        return told


@pytest.fixture
def rig() -> Rig:
    rig = Rig(Trainer(SCENARIO))
    rig.turn()
    return rig


_ids = itertools.count(1)


def _order(what: str, value: float = 0.0, age_s: float = 0.0) -> bodies.Order:
    return bodies.Order(id=next(_ids), what=what, value=value, age_s=age_s)


def _answer(rig: Rig, what: str, value: float = 0.0, age_s: float = 0.0) -> bodies.Answer:
    rig.trainer.obey([_order(what, value, age_s)])
    return rig.trainer.body().answers[-1]


def test_from_the_first_motion_to_well_done_and_again(rig: Rig) -> None:
    assert rig.turn().state == "armed"
    rig.y_m = 0.02
    rig.turn()
    rig.depth_m = 0.0105
    states = [rig.turn().state for _ in range(7)]
    assert states == ["running"] * 5 + ["done"] * 2
    done = rig.turn()
    assert (done.outcome, done.counts, done.goal_depth_m, done.scenario) == ("success", True, 0.01, "basic")
    assert _answer(rig, "new").ok
    begun = rig.turn()
    assert (begun.begins, begun.state, begun.time_s, begun.outcome) == (1, "armed", 0.0, "")
    assert begun.attempt_id != done.attempt_id
    assert rig.turn().depth_m == 0.0


def test_what_is_seen_before_the_scene_has_begun_again_is_not_of_the_new_attempt(rig: Rig) -> None:
    """While an arm's force fades the old scene goes on: deep in the duct, hands moving."""
    rig.y_m, rig.depth_m = 0.02, 0.015
    rig.turn()
    rig.deaf = True
    _answer(rig, "new")
    for y_m in (0.03, 0.05):
        rig.y_m = y_m
        told = rig.turn()
        assert (told.state, told.depth_m, told.began_tick) == ("armed", 0.0, -1)
    rig.deaf = False
    rig.turn()
    assert rig.turn().began_tick == rig.tick


def test_what_is_abandoned_is_told_before_the_next_begins(rig: Rig) -> None:
    rig.y_m = 0.02
    rig.turn()
    first, gist = rig.trainer.tell(), rig.trainer.gist()
    _answer(rig, "new")
    assert rig.trainer.gist() != gist
    gist = rig.trainer.gist()
    parting = rig.trainer.tell()
    assert (parting.attempt_id, parting.state) == (first.attempt_id, "abandoned")
    assert parting.begins == 0
    assert rig.trainer.gist() != gist, "the next is told at once after it"
    following = rig.trainer.tell()
    assert (following.state, following.begins) == ("armed", 1)
    assert following.attempt_id != first.attempt_id


def test_a_gateway_that_starts_anew_is_not_waited_for(rig: Rig) -> None:
    """It counts from nought, and the attempt would be armed for ever."""
    for _ in range(3):
        _answer(rig, "new")
        rig.turn()
        rig.turn()
    rig.begins, rig.tick, rig.incarnation = 0, 0, 2
    rig.turn()
    rig.y_m = 0.02
    rig.turn()
    assert rig.turn().state == "running"
    _answer(rig, "new")
    rig.deaf, rig.begins, rig.incarnation = True, 0, 3
    rig.y_m = 0.0
    rig.turn()
    rig.y_m = 0.02
    rig.turn()
    assert rig.turn().state == "running"


def test_an_order_is_carried_out_once_and_not_where_it_is_too_old(rig: Rig) -> None:
    order = _order("new")
    for _ in range(3):
        rig.trainer.obey([order])
    assert rig.trainer.body().begins == 1
    late = _answer(rig, "new", age_s=2.1)
    assert (late.ok, late.text, rig.trainer.body().begins) == (False, "came too late", 1)


@pytest.mark.parametrize(
    ("what", "value", "pace", "ok"),
    [
        ("pause", 0.0, 0.0, True),
        ("slow", 1 / 32, 1 / 32, True),
        ("slow", 0.03, 1.0, False),
        ("slow", 1.5, 1.0, False),
        ("resume", 0.0, 1.0, True),
        ("step", 5.0, 1.0, False),
        ("dance", 0.0, 1.0, False),
    ],
)
def test_orders_set_the_pace_or_are_refused_with_a_sentence(
    rig: Rig, what: str, value: float, pace: float, ok: bool
) -> None:
    answer = _answer(rig, what, value)
    assert (answer.ok, rig.trainer.body().pace) == (ok, pace)
    assert len(answer.text) > 5


def test_single_steps_are_counted_while_paused_and_spoil_an_attempt_as_slow_motion_does(rig: Rig) -> None:
    rig.y_m = 0.02
    rig.turn()
    _answer(rig, "pause")
    assert rig.trainer.body().counts
    assert _answer(rig, "step", 20.0).ok
    assert _answer(rig, "step", 1.0).ok
    assert not _answer(rig, "step", 1.9).ok
    told = rig.trainer.body()
    assert (told.steps, told.counts, told.why_not) == (21, False, "it was stepped through")
    _answer(rig, "new")
    rig.turn()
    assert rig.trainer.body().counts
    _answer(rig, "slow", 0.5)
    assert rig.trainer.body().why_not == "slow motion was used"


def test_a_bookmark_has_the_time_of_the_attempt(rig: Rig) -> None:
    rig.y_m = 0.02
    rig.turn()
    rig.turn(1234)
    _answer(rig, "bookmark")
    assert rig.trainer.body().bookmarks_s == (1.234,)


@pytest.mark.parametrize(
    ("state", "reason", "why_not"),
    [
        ("running", "", ""),
        ("degraded", "physics: 100 ticks lost", "the rig was late"),
        ("degraded", "visualization: 20 ticks lost", ""),
        ("safe_stop", "commanded", "the rig was stopped"),
    ],
)
def test_an_attempt_does_not_count_where_the_rig_was_late_at_what_the_hand_feels(
    state: str, reason: str, why_not: str
) -> None:
    rig = Rig(Trainer(SCENARIO, spared=["visualization"]))
    rig.turn()
    rig.y_m = 0.02
    rig.turn()
    rig.trainer.observer.take_rig(bodies.SupervisorState(state=state, reason=reason))
    told = rig.turn()
    assert (told.why_not, told.counts) == (why_not, not why_not)


def test_nor_where_a_process_began_anew(rig: Rig) -> None:
    rig.y_m = 0.02
    rig.turn()
    rig.incarnation = 2
    assert rig.turn().why_not == "a part of the rig began anew"


def test_a_button_that_is_kept_pressed_begins_again(rig: Rig) -> None:
    rig.buttons = 1
    begins = [rig.turn().begins for _ in range(25)]
    assert begins == [0] * 20 + [1] * 5


def test_the_next_begins_by_itself_after_a_success_where_the_rig_says_so() -> None:
    rig = Rig(Trainer(SCENARIO, again_after_s=2.0))
    rig.turn()
    rig.y_m = 0.02
    rig.turn()
    rig.depth_m = 0.011
    told = [rig.turn() for _ in range(30)]
    assert [each.begins for each in told].count(0) == 5 + 20
    assert told[-1].state == "armed"


def test_the_process_does_as_its_rig_says(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[float | None] = []

    class Kept(Trainer):
        def __init__(self, scenario: Scenario | None, again_after_s: float | None, *more: Any, **named: Any) -> None:
            super().__init__(scenario, again_after_s, *more, **named)
            made.append(self._again_after_s)

    monkeypatch.setattr(training_process, "Trainer", Kept)
    rig = load_rig("stub", ("training.again_after_s=7",))
    training_process.run(Mock(rig=rig, stop=lambda: True), (SCENARIO, None))
    assert made == [7.0]


def test_hints_come_and_go_with_their_reasons(rig: Rig) -> None:
    assert rig.turn().hint == "Grasp it."
    rig.y_m = 0.02
    rig.turn()
    assert rig.turn().hint == "Grasp the catheter."
    rig.kind = 1
    assert rig.turn().held == ("catheter",)
    assert rig.turn().hint == "Lead the tip of the catheter into the mouth of the duct."
    for depth_m, said in (
        (0.004, "Push on: 6 mm to go."),
        (0.0095, "Gently: almost there."),
        (0.0105, "Hold it there."),
    ):
        rig.depth_m = depth_m
        assert rig.turn().hint == said
    rig.force_n = 2.5
    assert rig.turn().hint == "Less force: the wall bears no more."
    assert hint(rig.trainer.attempt, rig.trainer.observer, None) == ""


def test_practice_without_a_scenario_is_told_as_such() -> None:
    rig = Rig(Trainer(None))
    told = rig.turn()
    assert (told.scenario, told.goal_depth_m, told.title) == ("", 0.0, "Practice without a goal")


class MadeUpJudge:
    """Finds one error with every three frames: a look."""

    phase = "P4"

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.taken = scenario, 0

    @property
    def errors(self) -> dict[str, int]:
        return {"E1": self.taken // 3}

    def take_frame(self, topic: str, time_ns: int, body: msgspec.Struct) -> None:
        self.taken += 1


def test_a_judge_of_its_own_sees_each_attempt_from_where_it_runs() -> None:
    rig = Rig(Trainer(SCENARIO, judges=MadeUpJudge))
    rig.turn()
    assert rig.turn().phase == ""
    rig.y_m = 0.02
    rig.turn()
    rig.turn()
    told = rig.turn()
    assert (told.phase, told.errors) == ("P4", {"E1": 2})
    _answer(rig, "new")
    assert rig.turn().errors == {}
    rig.turn()
    rig.y_m = 0.02
    rig.turn()
    assert rig.turn().errors == {"E1": 1}


def test_a_forbidden_error_fails_the_attempt() -> None:
    scenario = replace(SCENARIO, goal=Goal(depth_m=0.01, forbidden=("E1",)))
    rig = Rig(Trainer(scenario, judges=MadeUpJudge))
    rig.turn()
    rig.y_m = 0.02
    assert [rig.turn().outcome for _ in range(3)] == ["", "failure", "failure"]


class _Judged:
    """A judge that finds an error at the end of an attempt."""

    phase = "P4"

    def __init__(self) -> None:
        self.events: list[ErrorEvent] = []

    @property
    def errors(self) -> dict[str, int]:
        return {each.code: 1 for each in self.events}

    def take_frame(self, *_: object) -> None:
        """See nothing wrong."""

    def finish(self) -> None:
        self.events.append(
            ErrorEvent(code="E6", evidence="secured too deep", severity="consequential", phase="P4", begin_s=1.0,
                       end_s=1.0, worst=0.021, limit=0.02, unit="m")
        )  # fmt: skip


def test_the_score_is_told_when_it_is_done_with_what_the_end_was_judged_by() -> None:
    rules = load_rules()
    rig = Rig(Trainer(SCENARIO, judges=lambda _: _Judged(), rules=rules))
    rig.turn()
    rig.y_m = 0.02
    assert rig.turn().score == -1.0
    rig.depth_m = 0.0105
    while (told := rig.turn()).state == "running":
        assert (told.score, told.errors) == (-1.0, {})
    assert told.errors == {"E6": 1}
    assert told.score == pytest.approx(300.0 - told.time_s - rules.penalty_s["consequential"])
    assert rig.turn() == told, "and nothing is added"
    assert _answer(rig, "new").ok
    assert rig.turn().score == -1.0


WAYS = TubePaths(
    {
        "left": np.array([[0.0, 0.0, 0.0], [10e-3, 0.0, 0.0], [20e-3, 10e-3, 0.0]]),
        "right": np.array([[0.0, 0.0, 0.0], [10e-3, 0.0, 0.0], [20e-3, -10e-3, 0.0]]),
    }
)


@pytest.mark.parametrize(
    ("branch", "tip_m", "depth_m"), [("left", 8e-3, 10e-3 + 8e-3 * 2**0.5), ("right", 8e-3, 10e-3)]
)
def test_depth_on_the_way_to_a_branch_is_that_of_the_fork_on_another(branch, tip_m, depth_m):
    goal = Goal(depth_m=0.015, hold_s=0.5, branch=branch)
    observer = Trainer(replace(SCENARIO, goal=goal), ways=WAYS).observer
    physics = samples.physics_state(5, bodies.ToolReaction())
    particles = np.array([[0.0, 0.0, 0.0], [10e-3 + tip_m, tip_m, 0.0]])
    rod = msgspec.structs.replace(physics.catheter, position_m=pack(particles), inserted_length_m=0.03)
    outside = msgspec.structs.replace(rod, inserted_length_m=0.0)
    gateway = bodies.GatewayState(tick=5, instruments=(), begins=0)
    for catheter, expected_m in ((rod, depth_m), (outside, 0.0)):
        said = {"gateway.state": gateway, "physics.state": msgspec.structs.replace(physics, catheter=catheter)}
        observer.take_frames({name: Frame(1, name, 1, 1, 0, 0, 0, True, body) for name, body in said.items()}, 0)
        assert observer.observe().depth_m == pytest.approx(expected_m)


def test_a_branch_that_the_duct_has_not_is_refused_in_one_sentence():
    site = Site(mouth_m=(0, 0, 0), inward=(1, 0, 0), mouth_radius_m=1e-3, ways={"left": ((0, 0, 0), (1, 0, 0))})
    site.check_branch("left")
    site.check_branch("")
    with pytest.raises(ConfigError, match=r"goal\.branch: the duct has no end 'lef'; it has: left"):
        site.check_branch("lef")


def test_no_attempt_counts_where_hands_went_on_from_a_recording() -> None:
    trainer = Trainer(SCENARIO, never_counts="it goes on from a recording")
    for _ in range(2):
        told = trainer.body()
        assert (told.counts, told.why_not) == (False, "it goes on from a recording")
        trainer.begin_attempt("")


@pytest.mark.parametrize(("take_over", "goes_on"), [(True, True), (False, False)])
def test_a_replay_alone_is_judged_as_what_was_recorded(tmp_path: Path, take_over: bool, goes_on: bool) -> None:
    recording = tmp_path / "a.mcap"
    recording.touch()
    rig = load_rig("mouse", (f"replay.file={recording}", f"replay.take_over={str(take_over).lower()}"))
    assert training_process._goes_on_by_hand(rig) is goes_on
