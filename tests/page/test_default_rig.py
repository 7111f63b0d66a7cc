"""A newcomer with a mouse follows what the page says: the goal is reached in time, the score read, all begun again."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import chromium
from tests.page.newcomer import MOST_S, attempt, begin_again, jaws_mm, newcomer

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]


@pytest.mark.parametrize("run", [1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 6))])
def test_a_newcomer_reaches_the_goal_reads_the_score_and_begins_again(tmp_path: Path, run: int) -> None:
    """The time is that of the attempt's clock, which the rig keeps: a busy machine has no part in it."""
    with newcomer(tmp_path) as mouse:
        course = attempt(mouse)
        assert course.headline.startswith("Well done"), course
        assert course.clock_s <= MOST_S, course
        assert [each.split()[0] for each in course.hints[:2]] == ["Grasp", "Lead"], "the page said what to do"
        assert course.score.startswith("Score "), course
        assert 300.0 - MOST_S - 60.0 < float(course.score.split()[1]) < 300.0, course
        begin_again(mouse)
        assert mouse.browser.text("#attempt-score") == ""
        mouse.move(mouse.pixel(jaws_mm(mouse)))
        before = jaws_mm(mouse)
        mouse.wheel(1.0)
        assert jaws_mm(mouse)[2] < before[2], "the hands are still this person's"
