"""A step that is taken again begins with the whole state: a try that was taken back leaves nothing behind."""

from dataclasses import replace

import numpy as np
import pytest

from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from studies.stability.drive import reduced_duct
from studies.stability.families.abuse import KINDS

LEAVES, RETURNS = 330, 360
ROUNDING = 1e-10
"""In m and N: lists that were renewed in a try sum up in another order."""


def take_back_every_try(simulation):
    """Let every part of a step be taken twice, the first time for nothing."""
    take_part = simulation._take_part

    def take_again(tools, dt_s, halvings):
        simulation.duct.change_step(dt_s)
        simulation._start.note()
        simulation._move(tools, dt_s)
        simulation._start.put_back()
        return take_part(tools, dt_s, halvings)

    simulation._take_part = take_again


def run(play, prepare):
    """Return positions of the catheter, coordinates of the wall and the tools' forces of every tick."""
    simulation, tools, shown = Simulation(play.scene, reduced_duct(play.scene)), ToolInputs(), []
    prepare(simulation)
    for tick in range(len(play.hands)):
        play.hands.write(tick, tools)
        tools.present[0] &= not LEAVES <= tick < RETURNS
        simulation.step(tools)
        felt = simulation.tool_results.force_n.ravel()
        shown.append(np.concatenate([simulation.catheter.state.position_m.ravel(), simulation.duct.state.q, felt]))
    return np.array(shown)


@pytest.mark.parametrize(("kind", "ticks"), [("jammed", 500), ("all contacts at once, wall gives way", 120)])
def test_a_try_that_is_taken_back_leaves_nothing_behind(kind, ticks):
    """Tools grasp, press, leave and come back; before, jaws, sleep, friction and loads were those of the last try."""
    play = KINDS[kind](np.random.default_rng(3))
    play = replace(play, hands=play.hands.sampled(np.arange(ticks)))
    plain, tried = run(play, lambda _: None), run(play, take_back_every_try)
    assert np.abs(plain[-1]).max() > 1e-3, "something presses"
    np.testing.assert_allclose(tried, plain, rtol=0.0, atol=ROUNDING)
