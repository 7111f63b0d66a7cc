"""A step that is taken again begins with the whole state: a try that was taken back leaves nothing behind."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.judge.overlaps import OverlapJudge
from trocar.studies.stability.drive import reduced_duct
from trocar.studies.stability.families.abuse import KINDS
from trocar.studies.stability.finely import contact_forces_n
from trocar.studies.stability.situations import beside

LEAVES, RETURNS = 300, 330
GIVES_WAY = "all contacts at once, wall gives way"
ROUNDING = 1e-10
"""In m and N: lists that were renewed in a try sum up in another order."""


def take_back_every_try(simulation):
    """Let every part of a step be taken twice, the first time for nothing; what that has found is forgotten."""
    take_part = simulation._take_part

    def take_again(tools, dt_s):
        simulation.duct.change_step(dt_s)
        simulation._start.save()
        simulation._move(tools, dt_s)
        simulation._start.restore()
        simulation.solver.pricing.forget_known()
        return take_part(tools, dt_s)

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


# The first kind until a second try begins with two rows more, because it looks further ahead than one that goes on
# from what was priced. The second until the catheter slips: from there on rounding decides how its solves end. With a
# clip that presses the wall on the catheter rounding grows from the 24th tick.
@pytest.mark.parametrize(
    ("kind", "without", "ticks"),
    [("jammed", "", 486), (GIVES_WAY, "clip", 79), (GIVES_WAY, "", 25)],
)
def test_a_try_that_is_taken_back_leaves_nothing_behind(kind, without, ticks):
    """Tools grasp, press, leave and come back; before, jaws, sleep, friction and loads were those of the last try."""
    play = KINDS[kind](np.random.default_rng(3))
    effects = {name: settings for name, settings in play.scene.effects.items() if name != without}
    play = replace(play, hands=play.hands.sampled(np.arange(ticks)), scene=replace(play.scene, effects=effects))
    plain, tried = run(play, lambda _: None), run(play, take_back_every_try)
    assert np.abs(plain[-1]).max() > 1e-3, "something presses"
    np.testing.assert_allclose(tried, plain, rtol=0.0, atol=ROUNDING)


class Ways:
    """How far the catheter went in each part of a step, and how long that was."""

    def __init__(self, simulation):
        self._catheter, self.parts = simulation.catheter, []
        simulation.watcher = self

    def begin(self):
        self._start_m = self._catheter.state.position_m.copy()

    def end(self, dt_s):
        way_m = np.linalg.norm(self._catheter.state.position_m - self._start_m, axis=1).max()
        self.parts.append((dt_s, way_m))


def test_a_catheter_that_snaps_goes_no_further_in_a_part_than_contacts_are_seen_ahead():
    """It is slow when the step begins: nobody knows before how fast it gets. It is not torn, which would be undone."""
    play = KINDS["jammed"](np.random.default_rng(3))
    simulation, tools = Simulation(play.scene, reduced_duct(play.scene)), ToolInputs()
    tools.present[:] = False
    for _ in range(20):
        simulation.step(tools)
    catheter, ways = simulation.catheter.state, Ways(simulation)
    catheter.velocity_m_s[:] = 0.05
    catheter.position_m[-8:, 2] += 1e-3 * np.linspace(0.0, 1.0, 8) ** 2
    catheter.position_m[-1, 2] += 1.2e-3
    simulation.step(tools)
    assert sum(dt_s for dt_s, _ in ways.parts) == pytest.approx(1e-3)
    assert len(ways.parts) > 1
    assert max(way_m for _, way_m in ways.parts) <= LOOK_AHEAD_M


def test_a_catheter_thrown_at_a_tool_stops_at_it_though_it_was_no_candidate():
    """The gap is larger than that from which pairs get rows, and a step at that speed longer: the price must see it."""
    play = beside()
    simulation, tools = Simulation(play.scene, reduced_duct(play.scene)), ToolInputs()
    play.hands.write(0, tools)
    for _ in range(150):
        simulation.step(tools)
    for _ in range(40):
        tools.position_m[0, 2] -= 0.11e-3
        simulation.step(tools)
    catheter, ways, judge = simulation.catheter, Ways(simulation), OverlapJudge(simulation)
    x_m = catheter.state.position_m[:, 0]
    jaws_m = float(simulation.tools.segments[0, 1:, 1, 2].min()) - simulation.tools.radius_m[0, 1]
    assert jaws_m - catheter.state.position_m[29, 2] - catheter.radius_m > play.scene.contact.margin_m
    catheter.state.velocity_m_s[:, 2] += 1.9 * np.exp(-(((x_m - 66e-3) / 12e-3) ** 2)) * (abs(x_m - 67e-3) < 18e-3)
    simulation.step(tools)
    assert len(ways.parts) == 1
    assert np.linalg.norm(simulation.tool_results.force_n[0]) > 5e-3
    assert judge.look()["tool in catheter"] < 30e-6


def test_the_force_of_a_tick_is_that_of_its_last_part():
    """How a tick is split decides nothing. A grip tears, and its tick is split."""
    play = KINDS["pulled apart by both tools"](np.random.default_rng(3))
    simulation, tools = Simulation(play.scene, reduced_duct(play.scene)), ToolInputs()
    ways, felt_n = Ways(simulation), simulation.tool_results.force_n
    split = set()
    for step in range(len(play.hands)):
        before_n = felt_n.copy()
        ways.parts.clear()
        play.hands.write(step, tools)
        simulation.step(tools)
        contact_n = contact_forces_n(simulation)
        np.testing.assert_allclose(felt_n, contact_n, rtol=0, atol=1e-9)
        if len(ways.parts) > 1:
            split |= set(np.flatnonzero(np.linalg.norm(contact_n - before_n, axis=1) > 0.25).tolist())
    assert split == {0, 1}
