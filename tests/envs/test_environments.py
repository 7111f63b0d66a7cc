"""What both environments are held to: gymnasium's interface, and the same to the bit wherever and however often."""

from __future__ import annotations

import multiprocessing
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.envs.walks import SMALL, walk
from trocar.envs import Expert, Insertion, Navigation

STIFFNESS = {"catheter.youngs_modulus_pa": (18e6, 60e6)}
KINDS = (
    partial(Insertion, overrides=SMALL, randomise=STIFFNESS | {"catheter.n_segments": (38, 42)}),
    partial(
        Navigation,
        randomise=STIFFNESS | {"catheter.n_segments": (66, 68)},
        targets=("right_upper", "right_lower", "left_upper", "left_lower"),
    ),
)


def _walks() -> list[np.ndarray]:
    return [walk(kind()) for kind in KINDS]


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("Insertion", {"overrides": SMALL}),
        ("Navigation", {"scenario": "bronchoscopy"}),
        ("Navigation", {"scenario": "endovascular"}),
    ],
)
def test_the_checker_of_gymnasium_finds_nothing(name: str, settings: dict[str, Any]) -> None:
    """Warnings are errors here."""
    made = gymnasium.make(f"trocar/{name}-v0", **settings)
    check_env(made.unwrapped, skip_render_check=True)
    made.close()


def test_two_processes_and_two_episodes_see_the_same_to_the_bit() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        others = pool.apply(_walks)
    for kind, there in zip(KINDS, others, strict=True):
        here = kind()
        for again in (walk(here), walk(here)):
            np.testing.assert_array_equal(there, again)
        assert not np.array_equal(there, walk(here, seed=4))
        here.close()


@pytest.mark.parametrize("kind", KINDS)
def test_an_expert_goes_by_where_the_hands_are_and_never_rests(kind: Any) -> None:
    """What is a function of time cannot be copied from what is seen, and a copy of a rest stays there."""
    made = kind()
    made.reset(seed=0)
    expert, still = Expert(made), np.zeros(made.action_space.shape, np.float32)
    for k in range(60):
        if k % 20 == 10:
            made.step(still)
        action = expert.action()
        assert np.linalg.norm(action) > 0.1
        np.testing.assert_array_equal(action, Expert(made).action())
        made.step(action)
    made.close()
