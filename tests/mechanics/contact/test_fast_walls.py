"""Thin walls that turn or stiffen while two forceps cross: no tick ends with a body in the wall."""

import pytest

from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from studies.judge.overlaps import OverlapJudge
from studies.stability.drive import reduced_duct
from studies.stability.families.drawn import cases
from studies.stability.family import Draw, Reach

SEED, ALLOWED_M = 101, 0.06e-3


@pytest.mark.parametrize(
    ("number", "steps"),
    [
        pytest.param(52, (940, 965), id="sections turn: rows are linear, the catheter came to lie 0.17 mm deep"),
        pytest.param(75, (925, 935), id="jaws let go: the energy tank moved the wall 0.34 mm into the other jaws"),
    ],
)
def test_what_the_last_solve_says_is_where_the_bodies_are(number, steps):
    play = next(case for case in cases(Draw(Reach.LONG, SEED)) if case.name == f"number {number}").play()
    simulation, tools = Simulation(play.scene, reduced_duct(play.scene)), ToolInputs()
    judge = OverlapJudge(simulation)
    for step in range(steps[1]):
        play.hands.write(step, tools)
        simulation.step(tools)
        if step >= steps[0]:
            judge.look()
    assert max(judge.deepest.values()) < ALLOWED_M, judge.deepest
