"""The insertion and the miss on a running rig: the same hands as in process, through devices, bus and all processes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from protocol.bodies import Catheter, PhysicsState
from services.cache_directory import cache_directory
from services.mechanics.scenarios import insertion
from services.mechanics.simulation.scene_duct import build_scene_duct
from studies.feel.tracking import WITHIN, compare, find_pinch
from tests.rig.conftest import Observer, running_rig

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

PACE = 0.5  # of the hands: where a busy machine loses ticks they move on by less
LASTS_S = 200.0  # the scenarios take five seconds at this pace
FORCE_STEP_N = 0.3
DEEPEST_M = 0.1e-3


@dataclass
class Course:
    """Everything that physics said of a scenario."""

    observer: Observer

    @property
    def states(self) -> list[PhysicsState]:
        return self.observer.solved or []

    def reaches(self, inserted_m: float) -> bool:
        return bool(self.states) and self.states[-1].catheter.inserted_length_m >= inserted_m

    def is_bowed(self, by_m: float) -> bool:
        return bool(self.states) and _bow_m(self.states[-1].catheter) > by_m

    @staticmethod
    def steps_n(states: list[PhysicsState]) -> list[float]:
        """Return the largest change of a tool's force between neighbouring ticks."""
        return [
            max(math.dist(x.force_n, y.force_n) for x, y in zip(a.reactions(), b.reactions(), strict=True))
            for a, b in itertools.pairwise(states)
            if b.tick == a.tick + 1 and a.tools.shape == b.tools.shape
        ]


def course(name: str, folder: Path, is_there: Callable[[Course], bool], what: str) -> Course:
    """Return what a rig said whose devices follow a scenario in its scene, up to there.

    It has ended by then: what is computed of it afterwards has the machine.
    """
    overrides = [
        f"gateway.instruments.{i}.{device}.settings={{scenario: {name}, pace: {PACE}}}"
        for i in (0, 1)
        for device in ("arm", "grasp")
    ]
    with running_rig(folder, name, overrides, keeps_solved=True) as rig:
        seen = Course(rig.observer)
        rig.observer.until(lambda: is_there(seen), LASTS_S, what)
    return seen


def test_the_catheter_is_slid_20_mm_into_the_duct(tmp_path: Path) -> None:
    seen = course("insertion", tmp_path, lambda seen: seen.reaches(20e-3), "20 mm inserted")
    assert seen.states[-1].reactions()[0].holds == 2
    assert 0.0 < max(body.contacts.max_penetration_m for body in seen.states) < DEEPEST_M
    assert max(seen.steps_n(seen.states)) < FORCE_STEP_N
    pushes = [max(math.hypot(*body.reactions()[i].force_n) for body in seen.states) for i in (0, 1)]
    assert min(pushes) > 2e-3, "both hands feel something"
    said, scene = seen.observer.devices or [], insertion().scene
    wall = scene, build_scene_duct(scene, cache_directory() / "bases")
    catheter, _ = compare(said, seen.states, wall).solved
    assert len(catheter) > 0.9 * len(seen.states)
    assert np.mean(catheter < WITHIN) > 0.99, "the forces are those of the mechanics alone"
    pinch = find_pinch(said, seen.states, wall)
    assert abs(pinch.wall) < 0.02, "the wall is that of the full finite elements"
    assert pinch.applied < 0.1


@pytest.mark.long
def test_aimed_beside_the_mouth_it_buckles_outside(tmp_path: Path) -> None:
    seen = course("miss", tmp_path, lambda seen: seen.is_bowed(1e-3), "the catheter bows out")
    assert max(body.catheter.inserted_length_m for body in seen.states) == 0.0
    assert max(body.contacts.max_penetration_m for body in seen.states) < DEEPEST_M
    assert max(seen.steps_n(seen.states)) < FORCE_STEP_N
    assert max(math.hypot(*body.reactions()[0].force_n) for body in seen.states) > 0.02


def _bow_m(body: Catheter) -> float:
    """Return how much shorter the straight line is than the 35 mm of catheter before its tip."""
    x = body.position_m.view()
    arc_m = np.cumsum(np.linalg.norm(np.diff(x[::-1], axis=0), axis=1))
    last = int(np.searchsorted(arc_m, 35e-3))
    return float(arc_m[last] - np.linalg.norm(x[-1] - x[-2 - last]))
