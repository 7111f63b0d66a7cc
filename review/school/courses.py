"""Courses: tasks in order, what passes each, and how a trainee stands in one. A course is a file of configs/courses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
from pydantic import Field

from trocar.review.attempts.curve import cusum
from trocar.review.attempts.store.attempts import Listed
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Settings
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.scenario import load_scenario
from trocar.services.training.score import ScoreRules

Coaching = Literal["full", "faded", "none"]
_DAY_NS = 86_400 * 10**9  # of the world's time, as courses are judged by the same days everywhere


class PassRule(Settings):
    """What passes a task. All that is named must hold, for each of so many attempts in a row."""

    in_a_row: Annotated[int, Field(ge=1, le=50)] = Field(1, description="attempts one after the other that must pass")
    score: Annotated[float, Field(ge=0.0)] | None = Field(None, description="least score")
    errors: Annotated[int, Field(ge=0)] | None = Field(None, description="most errors")
    critical: Annotated[int, Field(ge=0)] = Field(0, description="most critical errors")
    cusum: bool = Field(False, description="whether CUSUM must show that failures are acceptably rare")
    days: Annotated[int, Field(ge=1, le=60)] = Field(1, description="different days on which attempts must be made")


class Step(Settings):
    """A task of a course."""

    title: Annotated[str, Field(min_length=1, max_length=128)]
    scenario: str = Field(description="a file of configs/scenarios")
    coaching: Coaching = Field("full", description="help while it is made: full, faded (the ghost fades) or none")
    passes: PassRule = PassRule()
    is_test: bool = Field(False, description="a test before or after: one attempt is enough, whatever its outcome")


class Course(Settings):
    """A file of configs/courses."""

    title: Annotated[str, Field(min_length=1, max_length=128)]
    about: Annotated[str, Field(max_length=512)] = ""
    most_a_day: Annotated[int, Field(ge=1, le=200)] | None = Field(
        None, description="attempts a day, as practice spread over days is kept better; none: no limit"
    )
    steps: Annotated[tuple[Step, ...], Field(min_length=1, max_length=40)]


class StepStanding(msgspec.Struct, frozen=True):
    """How a trainee stands at a task: passed, now or later; `told` says in parts of a sentence what passes it."""

    title: str
    scenario: str
    coaching: Coaching
    state: Literal["passed", "now", "later"]
    told: tuple[str, ...]
    done: int


@dataclass(frozen=True, slots=True)
class Made:
    """An attempt as a course sees it."""

    row: Listed
    examined: bool


def course_names() -> list[str]:
    """Return the bare names in configs/courses."""
    return sorted(path.stem for path in (config.config_directory() / "courses").glob("*.yaml"))


def load_course(name: str) -> Course:
    """Return the course of a file, or of a bare name in configs/courses.

    Raises ConfigError: one sentence that names the file and the key.
    """
    path = config.find("course", name)
    course = config.build(Course, config.read_yaml(path), str(path))
    for number, step in enumerate(course.steps):
        try:
            load_scenario(step.scenario)
        except ConfigError as error:
            raise ConfigError(f"{path}: steps.{number}.scenario: {error}") from None
    return course


def standing(course: Course, made: Sequence[Made], rules: ScoreRules) -> list[StepStanding]:
    """Return how a trainee stands at each task, by the attempts that count, oldest first.

    Attempts at a task count for it from the moment at which the one before was passed; an examination counts only
    attempts at which nobody helped.
    """
    standings: list[StepStanding] = []
    left, is_open = [each for each in made if each.row.counts], True
    for step in course.steps:
        mine = [each for each in left if each.row.scenario == step.scenario] if is_open else []
        mine = [each for each in mine if each.examined or step.coaching != "none"]
        passed_at = _passed_at(step, [each.row for each in mine], rules) if is_open else None
        state: Literal["passed", "now", "later"] = "later" if not is_open else "now" if passed_at is None else "passed"
        told = _told(step, [each.row for each in mine], rules)
        standings.append(StepStanding(step.title, step.scenario, step.coaching, state, told, len(mine)))
        if passed_at is None:
            is_open = False
        else:
            last = mine[passed_at]
            left = left[left.index(last) + 1 :]
    return standings


def _passed_at(step: Step, rows: Sequence[Listed], rules: ScoreRules) -> int | None:
    """Return the index of the attempt that passed a task, None if none did."""
    if step.is_test:
        return 0 if rows else None
    return next((k for k in range(len(rows)) if _holds(step, rows[: k + 1], rules)), None)


def _holds(step: Step, rows: Sequence[Listed], rules: ScoreRules) -> bool:
    rule = step.passes
    if _streak(rows, lambda row: _is_good(rule, row)) < rule.in_a_row:
        return False
    if len({row.began_ns // _DAY_NS for row in rows}) < rule.days:
        return False
    if not rule.cusum:
        return True
    chart = cusum([not _is_good(rule, row) for row in rows], rules.cusum)
    return chart.values[-1] <= chart.clear


def _is_good(rule: PassRule, row: Listed) -> bool:
    return (
        row.outcome == "success"
        and (rule.score is None or (row.total or 0.0) >= rule.score)
        and (rule.errors is None or row.errors <= rule.errors)
        and row.critical <= rule.critical
    )


def _streak(rows: Sequence[Listed], is_good: Callable[[Listed], bool]) -> int:
    """Return how many of the last attempts are good, one after the other."""
    return next((k for k, row in enumerate(reversed(rows)) if not is_good(row)), len(rows))


def _told(step: Step, rows: Sequence[Listed], rules: ScoreRules) -> tuple[str, ...]:
    """Return what passes a task, and how far one is, in parts of a sentence that a page puts commas between."""
    rule = step.passes
    if step.is_test:
        return ("One attempt", "whatever comes of it: it shows where you stand")
    wanted = ["Reach the goal"]
    wanted += [f"with a score of {rule.score:.0f} or more"] if rule.score is not None else []
    wanted += [f"with at most {rule.errors} errors"] if rule.errors is not None else []
    wanted += ["without a critical error"] if rule.critical == 0 else []
    streak = min(_streak(rows, lambda row: _is_good(rule, row)), rule.in_a_row)
    wanted += [f"{rule.in_a_row} times in a row ({streak} so far)"] if rule.in_a_row > 1 else []
    wanted += [f"on {rule.days} different days"] if rule.days > 1 else []
    wanted += ["and fail so rarely that CUSUM clears you"] if rule.cusum else []
    return tuple(wanted)


def today(rows: Sequence[Listed], now_ns: int) -> int:
    """Return how many attempts were made on this day."""
    return sum(row.began_ns // _DAY_NS == now_ns // _DAY_NS for row in rows)
