"""Either end of a lifeline notices that the other has ended, whatever was sent and not taken."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from trocar.services.supervisor.page.helper import Lifeline

Ends = tuple[Lifeline, Lifeline]


@pytest.fixture
def ends() -> Iterator[Ends]:
    """Return the supervisor's end, and a helper's."""
    ours, theirs = Lifeline.pair()
    with closing(ours), closing(theirs):
        yield ours, theirs


def test_signs_of_life_are_heard_once(ends: Ends) -> None:
    ours, theirs = ends
    assert not ours.heard()
    assert theirs.beat()
    assert ours.heard()
    assert not ours.heard()


@pytest.mark.parametrize("hears", [True, False])
def test_a_helper_notices_the_supervisors_end_whether_it_was_heard_or_not(ends: Ends, hears: bool) -> None:
    ours, theirs = ends
    assert theirs.beat()
    assert not hears or ours.heard()
    ours.close()
    assert not theirs.beat()


def test_a_supervisor_that_does_not_listen_holds_nobody_up(ends: Ends) -> None:
    """As one that a debugger stops, for longer than the kernel keeps signs."""
    ours, theirs = ends
    assert all(theirs.beat() for _ in range(10_000))
    assert ours.heard()
    ours.close()
    assert not theirs.beat()


def test_the_end_of_a_helper_is_no_sign_of_life(ends: Ends) -> None:
    ours, theirs = ends
    theirs.close()
    assert not ours.heard()
