"""Actions that are none: refused before anything moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.envs.walks import SMALL
from trocar.envs import Insertion


@pytest.fixture(scope="module")
def env() -> Iterator[Insertion]:
    made = Insertion(overrides=SMALL)
    made.reset(seed=1)
    yield made
    made.close()


@given(
    at=st.sets(st.tuples(st.integers(0, 1), st.integers(0, 4)), min_size=1),
    value=st.sampled_from((np.nan, np.inf, -np.inf)),
    seed=st.integers(0, 1 << 30),
)
@settings(max_examples=200, deadline=None)
def test_an_action_that_is_not_finite_is_refused_and_moves_nothing(
    env: Insertion, at: set[tuple[int, int]], value: float, seed: int
) -> None:
    action = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 5)).astype(np.float32)
    for place in at:
        action[place] = value
    before = env.hands.state.copy(), env.hands.rate.copy(), env.simulation.catheter.state.position_m.copy()
    with pytest.raises(ValueError, match=r"^action: \(\d, \d\) is -?(nan|inf), not a finite number$"):
        env.step(action)
    after = env.hands.state, env.hands.rate, env.simulation.catheter.state.position_m
    for was, is_ in zip(before, after, strict=True):
        np.testing.assert_array_equal(was, is_)


@pytest.mark.parametrize("shape", [(), (5,), (1, 5), (2, 4), (3, 5), (10,)])
def test_an_action_of_another_shape_is_refused_and_moves_nothing(env: Insertion, shape: tuple[int, ...]) -> None:
    before = env.hands.state.copy()
    with pytest.raises(ValueError, match=r"^action: its shape is .*, not \(2, 5\)$"):
        env.step(np.zeros(shape, np.float32))
    np.testing.assert_array_equal(before, env.hands.state)


def test_after_a_refused_action_the_next_one_is_taken(env: Insertion) -> None:
    with pytest.raises(ValueError, match="not a finite number"):
        env.step(np.full((2, 5), np.nan, np.float32))
    seen, reward, *_ = env.step(np.zeros((2, 5), np.float32))
    assert np.isfinite(seen).all()
    assert np.isfinite(reward)
