"""Intervals of rates."""

from __future__ import annotations

import pytest

from trocar.studies.rates import interval, rate


def test_the_interval_of_a_rate_is_that_of_clopper_and_pearson() -> None:
    """As published: Newcombe, Statistics in Medicine 17 (1998) 857, table I."""
    assert interval(81, 263) == pytest.approx((0.2527, 0.3676), abs=1e-4)
    assert interval(15, 148) == pytest.approx((0.0578, 0.1617), abs=1e-4)
    assert interval(0, 20) == pytest.approx((0.0, 0.1684), abs=1e-4)
    assert interval(1, 29) == pytest.approx((0.0009, 0.1776), abs=1e-4)
    assert interval(29, 29)[1] == 1.0


def test_a_rate_of_nothing_in_millions_is_no_zero() -> None:
    assert rate(0, 10**7) == "0 to 3.69e-05 %"
    assert rate(0, 0) == "0 to 100 %"
