"""The table of effects: what is in it, what is refused, and that what is not named is not there."""

from dataclasses import replace

import numpy as np
import pytest
from effect_runs import come_down, state

from trocar.services.mechanics.effects import EFFECTS, build_effects
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.simulation import Simulation


def test_table_names_what_each_effect_is_and_where_it_acts():
    for name, entry in EFFECTS.items():
        assert entry.what
        assert entry.stages, f"{name} acts nowhere"


def test_absent_effects_do_not_exist(with_effects, small_duct):
    simulation = Simulation(with_effects(), small_duct)
    assert simulation.effects == {}
    assert not any(simulation._stages.values())
    assert simulation.catheter.properties.torsional_stiffness_n_m2 is None


def test_unknown_effects_and_settings_of_another_are_refused_by_name(small_scene):
    with pytest.raises(ValueError, match=r"effects.gravitas: there is no such effect; known: .*gravity"):
        build_effects(replace(small_scene, effects={"gravitas": NoSettings()}))
    with pytest.raises(ValueError, match=r"effects.friction: takes FrictionSettings, not dict"):
        build_effects(replace(small_scene, effects={"friction": {"mu_static": 0.1}}))
    with pytest.raises(ValueError, match=r"kinetic friction 0.5 is not within 0 and static 0.1"):
        FrictionSettings(mu_kinetic=0.5, mu_static=0.1)


def test_all_effects_go_together(small_scene):
    every = {name: entry.kind.Settings() for name, entry in EFFECTS.items()}
    assert list(build_effects(replace(small_scene, effects=every))) == list(EFFECTS)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("gravity", {"acceleration_m_s2": (0.0, 0.0, 0.0)}),
        ("friction", {"mu_static": 0.0, "mu_kinetic": 0.0, "tool_mu_static": 0.0, "tool_mu_kinetic": 0.0}),
        ("grasp_slip", {}),
        ("self_contact", {}),
    ],
)
def test_effect_with_nothing_to_do_is_bit_identical_to_none(with_effects, small_duct, name, settings):
    ends = []
    for effects in ({}, {name: settings}):
        simulation = Simulation(with_effects(**effects), small_duct)
        tools = come_down(simulation)
        for _ in range(60):
            simulation.step(tools)
        ends.append(state(simulation))
    bare, idle = ends
    assert np.abs(bare).max() > 0.0
    assert np.array_equal(bare, idle)


def test_more_stones_than_identities_can_tell_apart_are_refused():
    GallstonesSettings(position_m=((0.0, 0.0, 0.0),) * 127, radius_m=(1e-3,) * 127)
    with pytest.raises(ValueError, match="128 stones are too many to be told apart, at most 127"):
        GallstonesSettings(position_m=((0.0, 0.0, 0.0),) * 128, radius_m=(1e-3,) * 128)
