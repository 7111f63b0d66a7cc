"""Rows that a price appends: W keeps what couples the rows before them, and is that of all rows."""

import numpy as np
import pytest

from trocar.services.mechanics.contact.system import ContactSystem
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of


@pytest.fixture
def assembled(monkeypatch):
    """Return a list of how far, relative to the largest item, each W in parts was from the same W made at once."""
    apart = []
    assemble = ContactSystem.assemble

    def twice(system):
        before, blocks = system._first_new, assemble(system)
        if before == 0:
            return blocks
        in_parts = system.compliance_m_n.copy()
        system.strategy.assemble(0)
        at_once = system.compliance_m_n
        apart.append(np.abs(in_parts - at_once).max() / np.abs(at_once).max())
        assert blocks == system.rows.n_contacts**2 - before**2
        return blocks

    monkeypatch.setattr(ContactSystem, "assemble", twice)
    return apart


@pytest.mark.parametrize("scene", ["pinch", "everything"], ids=["straight", "turned"])
def test_w_in_parts_is_that_of_all_rows(scene, assembled, cache_dir):
    """Hands tremble by a third of a millimetre a tick, so that prices find what had no row."""
    loaded = load_scene(scene)
    duct = load_duct(loaded, cache_dir, lambda *_: None)
    simulation, tools = Simulation(loaded, duct), ToolInputs()
    hands, random = hands_of(simulation.scene, duct.mesh), np.random.default_rng(3)
    for tick in range(600):
        hands.write_inputs(1e-3 * (tick + 1), tools)
        tools.position_m += 0.3e-3 * random.standard_normal((2, 3))
        simulation.step(tools)
    assert len(assembled) > 10
    assert max(assembled) < 1e-12
