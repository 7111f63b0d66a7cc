"""The slew limiter moves straight, by no more than a step, and ends exactly where it shall."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from trocar.services.gateway.servo.slew import slew, slew_vector

NUMBER = st.floats(-10.0, 10.0)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)


@settings(deadline=None)
@given(NUMBER, NUMBER, st.floats(0.0, 10.0))
def test_a_number_moves_by_no_more_than_a_step_and_towards_what_is_wanted(value: float, wanted: float, step: float):
    moved = slew(value, wanted, step)
    assert abs(moved - value) <= step * (1.0 + 1e-12) + 1e-12
    assert min(value, wanted) <= moved <= max(value, wanted)
    assert moved == wanted or abs(moved - value) >= step * (1.0 - 1e-9) - 1e-12


@settings(deadline=None)
@given(VECTOR, VECTOR, st.floats(0.0, 40.0))
def test_a_vector_stays_on_the_line_and_in_the_ball_of_both_ends(value, wanted, step):
    moved = slew_vector(value, wanted, step)
    assert math.dist(moved, value) <= step * (1.0 + 1e-9) + 1e-12
    assert math.hypot(*moved) <= max(math.hypot(*value), math.hypot(*wanted)) * (1.0 + 1e-9) + 1e-12
    if math.dist(value, wanted) <= step:
        assert moved == wanted
    else:
        assert math.dist(value, moved) + math.dist(moved, wanted) <= math.dist(value, wanted) * (1.0 + 1e-9) + 1e-12
