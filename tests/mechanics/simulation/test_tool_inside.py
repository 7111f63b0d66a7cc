"""A tool that is inside a wall is told of, once, and again after it was clear."""

from __future__ import annotations

import warnings

import pytest

from trocar.services.mechanics.simulation.inside_watch import InsideWatch, ToolInsideWarning


def test_each_entry_is_told_once() -> None:
    told: list[str] = []
    watch = InsideWatch(2)
    watch.tell = told.append
    looks = [((True, True), (False, True)), ((True, True), (False, True)), ((True, True), (False, False)),
             ((True, False), (False, True)), ((True, True), (True, True))]  # fmt: skip
    counts = []
    for present, disengaged in looks:
        watch.look(present, disengaged)
        counts.append(len(told))
    assert counts == [1, 1, 1, 1, 3]
    assert told[0].startswith("tool 1 is inside the wall or the catheter: it has no contact and no force")


def test_it_warns_unless_somebody_else_is_to_tell() -> None:
    with pytest.warns(ToolInsideWarning, match="tools.disengaged"):
        InsideWatch(1).look((True,), (True,))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        InsideWatch(1).look((True,), (False,))
