"""The hand of the study of folds, and what it is for: a fold that stops a push lets a turned, bent tip pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.scene.cystic_duct import CysticDuctScene, drawn_cystic_duct
from trocar.services.scenes.ready import load_duct
from trocar.studies.cystic_folds import (
    BACK_M,
    BENT_TIP,
    LIMIT_N,
    MOST_TRIES,
    TURN_RAD,
    Hand,
    goal_m,
    insert,
    scene_of,
    usual_edge_m,
)
from trocar.studies.fold_stiffness import crest_stiffness_n_m

STEP_S = 1e-3


def push_to(hand: Hand, stop_m: float, ticks: int) -> None:
    """Let a hand feel too much beyond a place that gives way to no force."""
    for _ in range(ticks):
        hand.move(2.0 * LIMIT_N if hand.way_m >= stop_m else 0.0, STEP_S)


def test_a_hand_that_only_pushes_gives_up_where_it_feels_too_much() -> None:
    hand = Hand(may_turn=False)
    push_to(hand, 10e-3, 2000)
    assert hand.gives_up
    assert (hand.roll_rad, hand.tries) == (0.0, 0)
    assert hand.way_m == pytest.approx(10e-3, abs=1e-4)


def test_one_that_turns_draws_back_before_it_turns_and_tries_again_there() -> None:
    hand = Hand(may_turn=True)
    push_to(hand, 10e-3, 520)
    assert hand.tries == 1
    back = [(hand.way_m, hand.roll_rad)]
    while hand.roll_rad < TURN_RAD:
        hand.move(0.0, STEP_S)
        back.append((hand.way_m, hand.roll_rad))
    assert min(way for way, _ in back) == pytest.approx(10e-3 - BACK_M, abs=1e-4)
    assert all(way < 10e-3 - BACK_M + 1e-4 for way, roll in back if roll > 0.0)
    push_to(hand, 10e-3, 60_000)
    assert hand.gives_up
    assert hand.tries == MOST_TRIES


def test_its_tries_begin_anew_at_the_next_fold() -> None:
    hand = Hand(may_turn=True)
    push_to(hand, 10e-3, 4000)
    before = hand.tries
    assert 1 < before < MOST_TRIES
    push_to(hand, 13e-3, 60_000)
    assert hand.gives_up
    assert hand.tries == before + MOST_TRIES


def test_a_fold_that_stops_a_push_is_passed_by_a_bent_tip_that_is_turned_and_not_by_a_straight_one(
    tmp_path: Path,
) -> None:
    drawn = replace(drawn_cystic_duct(CysticDuctScene(seed=3, common_length_m=20e-3)), fold_height=0.85)
    duct = load_duct(scene_of(tmp_path, drawn), cache_directory(), ignore_progress)

    def passes(may_turn: bool, tip: tuple) -> bool:
        return bool(insert(scene_of(tmp_path, drawn, tip), duct, Hand(may_turn), goal_m(drawn), STEP_S)["passed"])

    assert not passes(False, (BENT_TIP,))
    assert not passes(True, ())
    assert passes(True, (BENT_TIP,))


def test_folds_are_as_stiff_on_a_finer_mesh_within_five_per_cent(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, drawn_cystic_duct(CysticDuctScene(seed=3, common_length_m=20e-3)))
    edge_m = usual_edge_m(scene)
    usual, finer = (
        np.concatenate(crest_stiffness_n_m(replace(scene, duct=replace(scene.duct, mesh_edge_m=share * edge_m))))
        for share in (1.0, 0.7)
    )
    assert len(usual) == 8  # of five folds; the common duct has taken in the wall of the last
    assert finer == pytest.approx(usual, rel=0.05)
