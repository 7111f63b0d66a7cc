"""The family in which everything is drawn: how widely, and what it is judged by that no other family needs."""

from dataclasses import asdict

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability import crossing
from trocar.studies.stability.criteria import CRITERIA
from trocar.studies.stability.drawn_report import KINDS, drawn_section
from trocar.studies.stability.drive import reduced_duct
from trocar.studies.stability.families import FAMILIES, drawn
from trocar.studies.stability.family import Draw, Reach
from trocar.studies.stability.lead import HandLead
from trocar.studies.stability.situations import threaded
from trocar.studies.stability.suite import Order, Result, list_cases
from trocar.studies.stability.tick_times import TickTimes
from trocar.studies.stability.watch import Watch

MANY = [drawn._draw(Draw(Reach.LONG, 7), k) for k in range(200)]


def test_it_comes_first_and_as_often_as_asked_for():
    assert next(iter(FAMILIES)) == "drawn"
    quick = Order(Reach.QUICK, 1, ("drawn",))
    assert len(list_cases(quick)) == drawn.QUICK_COUNT
    assert len(list_cases(Order(Reach.QUICK, 1, ("drawn",), cases=60))) == 60
    assert list_cases(Order(Reach.LONG, 1, ("drawn",), cases=60))[: drawn.QUICK_COUNT] == list_cases(quick)


def test_every_shape_and_every_effect_is_drawn_and_softening_in_the_quick_form_too():
    assert {each.shape for each in MANY} == set(drawn.SHAPES)
    named = [name for each in MANY for name in each.scene.effects]
    assert min(named.count(name) for name in set(named)) > 20
    quick = [drawn._draw(Draw(Reach.QUICK, seed), k) for seed in range(3) for k in range(drawn.QUICK_COUNT)]
    assert any("softening" in each.scene.effects for each in quick)


def test_nothing_is_drawn_that_does_not_go_together():
    """Sections that turn are for a tube: a fork that had them was refused, which ended all of a run."""
    forked = [each.scene for each in MANY if each.scene.duct.branches]
    assert len(forked) > 20
    assert not any("large_rotations" in scene.effects for scene in forked)


def test_it_is_drawn_as_widely_as_it_is_told():
    ducts, catheters = [each.scene.duct for each in MANY], [each.scene.catheter for each in MANY]
    thin = np.array([duct.thickness_m / duct.radius_m for duct in ducts])
    assert 0.02 <= thin.min() < 0.025
    assert 0.2 < thin.max() <= 0.25
    soft_pa = np.array([duct.youngs_modulus_pa for duct in ducts])
    assert 20e3 <= soft_pa.min() < 25e3
    assert 1.6e6 < soft_pa.max() <= 2e6
    rods_pa = np.array([catheter.youngs_modulus_pa for catheter in catheters])
    assert 1e6 <= rods_pa.min() < 1.5e6
    assert 1.5e9 < rods_pa.max() <= 2e9
    radii = np.array([c.outer_diameter_m / d.radius_m for c, d in zip(catheters, ducts, strict=True)])
    assert 0.2 <= radii.min() < 0.25
    assert 1.2 < radii.max() < 1.9
    friction = [each.scene.effects["friction"].mu_static for each in MANY if "friction" in each.scene.effects]
    assert 0.0 <= min(friction) < 0.05
    assert 1.1 < max(friction) <= 1.2


@pytest.mark.parametrize("k", range(6))
def test_hands_are_those_of_a_person(k):
    each = MANY[k]
    hands = drawn._hands(each, drawn._mesh(each.scene.duct))
    assert 0.02 < hands.top_speed_m_s(1e-3) <= 1.001 * crossing.FASTEST_M_S


def pressing(follow=True):
    """The lead of hands that close on catheter and wall and lift them, at a tick in which tools may stay behind."""
    start, tools = threaded(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    lead, hands = HandLead(simulation), start.hands.then(100)
    hands = hands.moved(0, np.outer(1e-4 * np.arange(1, 101), (0.0, 0.0, 1.0)), len(start.hands))
    for step in range(len(hands)):
        hands.write(step, tools)
        kept_m = simulation.tools.proxy[:, :3].copy()
        simulation.step(tools)
        if not follow and step > len(start.hands):
            simulation.tools.proxy[:, :3] = kept_m
        lead.look(tools, 1e-3)
    return lead.figures(), float(np.abs(simulation.tool_results.force_n).max())


def test_what_a_coupling_explains_is_no_lead():
    figures, force_n = pressing()
    assert force_n > 0.1
    assert figures["hand_lead"] < 0.05e-3
    assert figures["withheld"] == 0.0


def test_a_tool_that_stays_behind_is_one():
    assert pressing(follow=False)[0]["hand_lead"] > CRITERIA["hand_lead"].limit


def test_time_that_did_not_happen_is_counted():
    start, tools = threaded(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    lead = HandLead(simulation)
    simulation.withheld_s = 0.25e-3
    lead.look(tools, 1e-3)
    assert lead.figures()["withheld"] == pytest.approx(0.25)


def test_a_jaw_whose_axis_is_through_the_wall_is_counted():
    start, tools = threaded(), ToolInputs()
    simulation = Simulation(start.scene, reduced_duct(start.scene))
    start.hands.write(0, tools)
    simulation.step(tools)
    watch = Watch(simulation, 0.1)
    watch._judge_overlaps()
    assert watch.worst["tool_crossings"] == 0
    simulation.tools.proxy[1, 2] -= 6e-3
    watch._judge_overlaps()
    assert watch.worst["tool_crossings"] > 0


def test_tails_of_ticks_are_told_and_never_judged():
    times = TickTimes()
    for ns in (1_000_000,) * 96 + (6_000_000,) * 3 + (30_000_000,):
        times.enter(ns)
    assert times.figures() == {
        "tick_median": pytest.approx(1e-3),
        "tick_longest": pytest.approx(30e-3),
        "ticks_above_5_ms": pytest.approx(0.04),
        "ticks_above_20_ms": pytest.approx(0.01),
    }
    assert all(CRITERIA[name].limit == np.inf for name in times.figures())


def test_the_page_tells_its_rates_first_with_what_failing_cases_have_in_common():
    fine = {"hand_lead": 1e-3, "withheld": 0.0, "tick_longest": 5e-3, "tick_median": 1e-3}
    fine |= {"ticks_above_5_ms": 0.0, "ticks_above_20_ms": 0.0, "healed": 0.0}
    results = [
        Result("drawn", "number 0", fine, 1000, 1.0),
        Result("drawn", "number 1", fine | {"healed": 2.0, "withheld": 0.1, "ticks_above_5_ms": 0.04}, 3000, 1.0),
    ]
    assert asdict(results[0])["family"] == "drawn"
    written = "\n".join(drawn_section(Order(Reach.LONG, 7, ("drawn",)), {7: results}))
    assert f"| {KINDS[0].name} | 1 | 1.26 to 98.7 % | healed 1 |" in written
    assert "| time withheld | 1 | 1.26 to 98.7 % | withheld 1 |" in written
    assert "Of 4,000 ticks 3 % took more than 5 ms" in written
    assert "7.5 % of the simulated time did not happen" in written
    assert "| number 1 | 7 | healed 2, withheld 0.1 |" in written
    for trait in {*drawn._traits(lambda: MANY[0]), *drawn._traits(lambda: MANY[1])}:
        assert f"| {trait} | " in written


def test_there_is_no_section_without_drawn_cases():
    assert drawn_section(Order(Reach.QUICK, 1, ("theory",)), {1: []}) == []


def test_a_catheter_that_fills_the_lumen_has_room_for_every_candidate():
    """Drawn case 48 of seed 121203: 4,096 places for some 5,700 closest pairs, so what was last was not looked at.

    The catheter then lay 0.8 mm deep in the wall.
    """
    play = FAMILIES["drawn"].cases(Draw(Reach.QUICK, 121203, 60))
    scene = next(each for k, each in enumerate(play) if k == 48).play().scene
    simulation, tools = Simulation(scene, reduced_duct(scene)), ToolInputs()
    tools.present[:] = False
    simulation.step(tools)
    assert simulation.world.search.n_candidates > 4500
    assert simulation.world.search.dropped == 0
