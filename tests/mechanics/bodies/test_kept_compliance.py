"""Forces with the compliance of touched nodes kept are those with all of it gathered anew in every tick.

The tool rests on the same points all the time: where it slides, contacts that come and go amplify any rounding.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from trocar.services.mechanics.bodies import wall_motion
from trocar.services.mechanics.reduction.large_rotations.warping import TubeWarp
from trocar.services.mechanics.reduction.node_compliance import NodeCompliance
from trocar.services.mechanics.scene import QualityLevel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation

N_TICKS = 240


@pytest.fixture
def forces_with_places(with_effects, small_duct, monkeypatch):
    """(t, 2, 3) forces of a tool that presses on the duct and goes on at another quality, and in other steps."""

    def run(n_places, *effects):
        monkeypatch.setattr(wall_motion, "NodeCompliance", partial(NodeCompliance, n_places=n_places))
        levels = (QualityLevel(), QualityLevel(name="high", iterations=50))
        duct = small_duct
        if "large_rotations" in effects:
            warp = TubeWarp.from_basis(duct.mesh, duct.basis, duct.mesh.vertex_sets["clamped"])
            duct = replace(duct, warp=warp)
        scene = with_effects(friction={}, **{name: {} for name in effects})
        simulation = Simulation(replace(scene, quality=levels), duct)
        tools, forces = ToolInputs(), []
        tools.present[1] = False
        for tick in range(N_TICKS):
            simulation.set_quality(1 if 100 <= tick < 160 else 0)
            above_m = 4e-3 * max(1.0 - tick / 80.0, 0.0)
            tools.position_m[0] = 20.7e-3, 0.4e-3, 15e-3 + 4.2e-3 + above_m - 0.5e-3 * (1.0 - np.cos(tick / 30.0))
            simulation.step(tools, dt_s=0.5e-3 if tick >= 200 else 1e-3)
            forces.append(simulation.tool_results.force_n.copy())
        return np.array(forces), simulation

    return run


@pytest.mark.parametrize(
    "effects", [(), ("viscoelasticity",), ("large_rotations",), ("large_rotations", "viscoelasticity")], ids="+".join
)
def test_forces_are_those_of_the_compliance_gathered_in_double_precision(forces_with_places, effects):
    kept, simulation = forces_with_places(128, *effects)
    anew, _ = forces_with_places(1, *effects)
    largest = np.abs(anew).max()
    apart = np.abs(kept - anew).max() / largest
    print(f"forces up to {largest:.3f} N differ by {apart:.1e} of that")
    assert simulation.contacts.n_contacts >= 2
    assert largest > 0.03
    assert 0.0 < apart < 1e-6
