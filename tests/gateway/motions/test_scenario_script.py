from __future__ import annotations

import numpy as np
import pytest

from trocar.services.gateway.motions.scenario_script import scenario_player
from trocar.services.gateway.motions.script import HANDLE, HIP, ROLL
from trocar.services.mechanics.scenarios import SCENARIOS
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.runtime.errors import ConfigError


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_simulated_hand_moves_as_the_mechanics_says(name: str, index: int) -> None:
    scenario = SCENARIOS[name]()
    forceps = scenario.scene.forceps[index]
    player = scenario_player(name, index, forceps.port_position_m)
    inputs, before, after = ToolInputs(), ToolInputs(), ToolInputs()
    for time_s in np.linspace(0.0, 1.2 * scenario.duration_s, 50):
        scenario.write_inputs(float(time_s), inputs)
        player.sample(float(time_s))
        np.testing.assert_allclose(player.value[HIP : HIP + 3], inputs.position_m[index], atol=1e-12)
        scenario.write_inputs(float(time_s) - 1e-5, before)
        scenario.write_inputs(float(time_s) + 1e-5, after)
        rate = (after.position_m[index] - before.position_m[index]) / 2e-5
        np.testing.assert_allclose(player.rate[HIP : HIP + 3], rate, atol=1e-6)
        assert player.value[ROLL] == pytest.approx(inputs.roll_rad[index])
        assert player.value[HANDLE] * forceps.jaw_ratio == pytest.approx(inputs.jaw_angle_rad[index])


def test_an_unknown_scenario_is_told_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no scenario 'surgery'; known: insertion, miss"):
        scenario_player("surgery", 0, (0.0, 0.0, 0.0))


def test_an_instrument_too_many_is_told() -> None:
    with pytest.raises(ConfigError, match="'insertion' has no motion for instrument number 2"):
        scenario_player("insertion", 2, (0.0, 0.0, 0.0))
