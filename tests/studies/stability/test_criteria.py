"""The criteria are data, and a figure that is no number fails."""

import math

import pytest

from trocar.studies.stability.criteria import CRITERIA, failures, load_of


def test_a_figure_beyond_its_limit_fails_and_one_that_is_not_asked_for_does_not():
    assert failures({"rest": 2.0, "force_step": 0.29}) == []
    assert failures({"rest": 2.01, "gain": 0.02}) == ["gain", "rest"]


@pytest.mark.parametrize("name", [name for name in CRITERIA if math.isfinite(CRITERIA[name].limit)])
def test_what_is_not_a_number_fails_every_criterion(name):
    assert failures({name: math.nan}) == [name]
    assert load_of(name, math.nan) == math.inf


def test_how_near_a_figure_is_to_its_limit():
    assert load_of("rest", 1.0) == 0.5
    assert load_of("crossings", 0.0) == 0.0
    assert load_of("crossings", 1.0) == math.inf
