"""The newcomer's rig, browser and attempt: for who makes it, and for who scores it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from tests.page.newcomer import Course, Mouse, attempt, begin_again, newcomer
from trocar.protocol.bodies import Attempt


@dataclass
class Made:
    """An attempt as the page showed it, and as the rig told it."""

    course: Course
    told: Attempt


@pytest.fixture(scope="package")
def mouse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mouse]:
    with newcomer(tmp_path_factory.mktemp("newcomer")) as mouse:
        yield mouse


@pytest.fixture(scope="package")
def first(mouse: Mouse) -> Made:
    """Return the first attempt of the rig; all has begun again since."""
    return make_attempt(mouse)


def make_attempt(mouse: Mouse) -> Made:
    """Make an attempt, and begin again."""
    mouse.arrive()
    course = attempt(mouse)
    begin_again(mouse)
    told = [frame.body for frame in mouse.rig.observer.bus.drain("training.attempt")]
    return Made(course, next(each for each in reversed(told) if each.state == "done"))
