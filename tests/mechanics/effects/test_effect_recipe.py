"""docs/recipes.md, "Adding an effect", followed to the letter: one file, one row, its name in a scene."""

import importlib
import sys
from dataclasses import replace

import numpy as np
import pytest

from services.mechanics import effects
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.energy import EnergyBook
from services.runtime.errors import ConfigError
from services.scenes import load_scene

FILE = '''
"""A steady current along the catheter's scene axes."""

from dataclasses import dataclass

import numpy as np

from services.mechanics.effects.base import Effect


@dataclass(frozen=True, slots=True)
class CurrentSettings:
    """Force on every particle."""

    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Current(Effect):
    """A constant force on every particle: conservative."""

    Settings = CurrentSettings

    def add_loads(self, simulation, dt_s):
        """Push the particles."""
        simulation.catheter.external_force_n += np.array(self.settings.force_n)

    def potential_energy_j(self, simulation):
        """Less by what the current has moved."""
        return -float(np.sum(simulation.catheter.state.position_m @ np.array(self.settings.force_n)))
'''


@pytest.fixture
def current(tmp_path, monkeypatch):
    """The file, where Python looks for the effects' files, and the row."""
    (tmp_path / "current.py").write_text(FILE)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    importlib.invalidate_caches()
    module = importlib.import_module("services.mechanics.effects.current")
    monkeypatch.setitem(effects.EFFECTS, "current", effects.EffectEntry(module.Current, (), "a steady current"))
    yield module.Current
    monkeypatch.delitem(sys.modules, "services.mechanics.effects.current")


def test_one_file_and_one_row_make_an_effect(current, with_effects, small_duct):
    scene = with_effects(current={"force_n": (0.0, 1e-4, 0.0)})
    scene = replace(scene, catheter=replace(scene.catheter, anchor="free", viscous_drag_n_s_m2=0.0))
    scene = replace(scene, catheter=replace(scene.catheter, tip_position_m=(60e-3, 40e-3, 0.0)))
    simulation, tools = Simulation(scene, small_duct), ToolInputs()
    tools.present[:] = False
    book = EnergyBook(simulation)
    for _ in range(100):
        book.step(tools)
    mass_kg = simulation.catheter.properties.particle_mass_kg()
    momentum = mass_kg @ simulation.catheter.state.velocity_m_s
    assert momentum == pytest.approx([0.0, 0.1 * 31 * 1e-4, 0.0], abs=1e-12)
    assert abs(book.flow.imbalance_j) < 1e-9
    assert effects.EFFECTS["current"].stages == ("add_loads",)
    assert np.all(simulation.duct.state.q == 0.0)


def test_a_scene_file_names_it_and_its_keys_are_checked(current, tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("effects: {current: {force_n: [0.0, 0.0, 1.0e-3]}}\n")
    built = effects.build_effects(load_scene(path))
    assert isinstance(built["current"], current)
    path.write_text("effects: {current: {force: 1.0}}\n")
    with pytest.raises(ConfigError, match=r"effects.current: unknown key 'force'; known: force_n"):
        load_scene(path)


def test_a_scene_that_does_not_name_it_never_makes_one(current, with_effects, small_duct, monkeypatch):
    monkeypatch.setattr(current, "__init__", lambda *_: pytest.fail("constructed"))
    assert Simulation(with_effects(), small_duct).effects == {}
