"""Energy books with everything that dissipates switched on, one at a time and all together."""

from dataclasses import replace

import pytest

from services.mechanics import scenarios
from services.mechanics.effects.base import NoSettings
from services.mechanics.effects.gallstones import GallstonesSettings
from services.mechanics.effects.mucus_drag import MucusDragSettings
from services.mechanics.effects.viscoelasticity import ViscoelasticitySettings
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.energy import EnergyBook
from services.mechanics.simulation.scene_duct import build_scene_duct

ON_TOP = {
    "viscoelasticity": ViscoelasticitySettings(),
    "mucus_drag": MucusDragSettings(),
    "gallstones": GallstonesSettings(position_m=((26e-3, 0.0, -1.4e-3),), radius_m=(1.5e-3,)),
    "twist": NoSettings(),
}


def insert(cache_dir, effects, **catheter):
    scenario = scenarios.insertion()
    scene = replace(scenario.scene, effects={**scenario.scene.effects, **effects})
    scene = replace(scene, catheter=replace(scene.catheter, **catheter))
    simulation, tools = Simulation(scene, build_scene_duct(scene, cache_dir)), ToolInputs()
    scenario.write_inputs(0.0, tools)
    simulation.step(tools)
    book = EnergyBook(simulation)
    for tick in range(2000):
        scenario.write_inputs(1e-3 * tick, tools)
        book.step(tools)
    return simulation, book.flow


def test_books_balance_over_an_insertion_with_friction_in_the_introducer(cache_dir):
    free = insert(cache_dir, {}, introducer_seal_friction_n=0.0)[1]
    simulation, flow = insert(cache_dir, {}, introducer_friction=0.3)
    assert simulation.inserted_length_m > 20e-3
    assert abs(flow.imbalance_j) < 0.01 * flow.input_j
    # 20 mN over 27.5 mm is 0.55 mJ; the wall's share comes on top.
    assert flow.rod_j - free.rod_j > 0.55e-3
    assert flow.input_j > 2.0 * free.input_j


def test_books_balance_with_every_dissipating_effect(cache_dir):
    simulation, flow = insert(cache_dir, ON_TOP, introducer_friction=0.3)
    assert simulation.inserted_length_m > 15e-3
    assert abs(flow.imbalance_j) < 0.01 * flow.input_j
    assert flow.effects_j > 1e-6
    assert flow.friction_j > 1e-6


@pytest.mark.parametrize("name", ["viscoelasticity", "gallstones"])
def test_an_effect_that_would_hide_its_losses_shows_in_the_books(cache_dir, name, monkeypatch):
    """What the effect says it dissipates is what is missing without it."""
    simulation, flow = insert(cache_dir, {name: ON_TOP[name]})
    told_j = simulation.effects[name].dissipated_j
    assert told_j == pytest.approx(flow.effects_j, rel=1e-3)
    assert told_j > 0.0
