"""A wall with branches: any opening is entered by the same code, and twist and steering decide the branch."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.scene import CatheterScene, CatheterSection, DriveScene, DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.centreline import centrelines
from trocar.services.meshes.branching import load_branching
from trocar.services.meshes.tube_paths import TubePaths

LENGTH_M = 0.12
SCENE = SceneModel(
    duct=DuctScene(
        radius_m=4.5e-3, length_m=30e-3, n_modes=40, thickness_m=1e-3, youngs_modulus_pa=300e3,
        branches=(
            DuctBranch(name="left", angle_rad=0.55, radius_m=3.6e-3, length_m=24e-3, end="free"),
            DuctBranch(name="right", angle_rad=0.55, azimuth_rad=np.pi, radius_m=3.6e-3, length_m=24e-3),
        ),
    ),
    catheter=CatheterScene(
        n_segments=60, length_m=LENGTH_M, before_mouth_m=4e-3, introducer_to_tip_m=8e-3,
        introducer_length_m=LENGTH_M - 8e-3, outer_diameter_m=1.6e-3, youngs_modulus_pa=30e6,
        sections=(CatheterSection(length_m=14e-3, youngs_modulus_pa=10e6, steering_1_m_rad=(70.0, 0.0, 0.0)),),
    ),
    forceps=(DriveScene(),),
    effects={"twist": NoSettings(), "friction": FrictionSettings(mu_static=0.1, mu_kinetic=0.1)},
)  # fmt: skip


@pytest.fixture(scope="module")
def duct(cache_dir):
    return build_scene_duct(SCENE, cache_dir, mesh=load_branching(duct_tubes(SCENE.duct), 1.6e-3, cache_dir))


class Run:
    """A catheter before an opening, and the hand at its end."""

    def __init__(self, duct, opening="mouth", **catheter):
        scene = replace(SCENE, catheter=replace(SCENE.catheter, opening=opening, **catheter))
        self.simulation = Simulation(scene, duct)
        catheter = place_catheter(scene, duct.mesh).catheter
        self.along = np.array(catheter.direction)
        self.tools = ToolInputs()
        self.tools.present[1] = False
        self.tools.position_m[0] = np.array(catheter.tip_position_m) - (LENGTH_M + 1e-3) * self.along
        self.simulation.step(self.tools)

    def lead(self, seconds, pushed_m=0.0, rolled_rad=0.0, handle_rad=0.0):
        ticks = round(1e3 * seconds)
        for _ in range(ticks):
            self.tools.position_m[0] += pushed_m / ticks * self.along
            self.tools.roll_rad[0] += rolled_rad / ticks
            self.tools.jaw_angle_rad[0] += handle_rad / ticks
            self.simulation.step(self.tools)

    @property
    def deepest_m(self):
        """Of the catheter in the wall, as both are drawn: between points of all triangles and of the axis."""
        mesh, wall_m = self.simulation.duct.reduced.mesh, self.simulation.duct.surface_m()
        corners = wall_m[mesh.triangles]
        weights = np.array([(a, b, 6 - a - b) for a in range(7) for b in range(7 - a)]) / 6.0
        samples = np.einsum("wk,tkx->twx", weights, corners).reshape(-1, 3)
        x = self.simulation.catheter.state.position_m
        fine = (x[:-1, None] + np.linspace(0.0, 1.0, 6)[:, None] * np.diff(x, axis=0)[:, None]).reshape(-1, 3)
        return self.simulation.catheter.radius_m + 0.5e-3 - cKDTree(samples).query(fine)[0].min()


@pytest.mark.parametrize("opening", ["mouth", "left", "right"])
def test_each_opening_is_entered_by_the_same_code(duct, opening):
    run = Run(duct, opening)
    assert run.simulation.entered_by == ""
    assert run.simulation.inserted_length_m == 0.0
    run.lead(0.5, pushed_m=16e-3)
    assert run.simulation.entered_by == opening
    assert run.simulation.inserted_length_m == pytest.approx(12e-3, abs=1e-3)
    assert run.simulation.inside.sum() == pytest.approx(6, abs=1)
    assert run.deepest_m < 0.1e-3
    run.lead(0.5, pushed_m=-15e-3)
    assert run.simulation.entered_by == ""


def goes_to(duct, roll_rad, handle_rad=0.7):
    run = Run(duct)
    run.lead(0.5, pushed_m=22e-3, rolled_rad=roll_rad)
    run.lead(0.3, handle_rad=handle_rad)
    deepest_m = 0.0
    for _ in range(5):
        run.lead(0.2, pushed_m=5e-3)
        deepest_m = max(deepest_m, run.deepest_m)
    assert deepest_m < 0.1e-3
    assert run.simulation.healed_states == 0
    return TubePaths(centrelines(duct.mesh)).place(run.simulation.catheter.state.position_m[-1])


def test_twist_and_steering_decide_the_branch(duct):
    """The same pushes of a bent tip: turned by half a turn it goes the other way."""
    found = {roll_rad: goes_to(duct, roll_rad) for roll_rad in (0.0, np.pi)}
    assert {name for name, _ in found.values()} == {"left", "right"}
    assert all(depth_m > 38e-3 for _, depth_m in found.values())
