"""A wall that is moved as a sine: its force leads the motion by the loss tangent of its Prony series."""

import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp
from trocar.services.mechanics.reduction import DuctRecipe, reduce_duct
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.accuracy.squeezed_wall import DT_S, SqueezedWall

USUAL = PronySeries((0.2, 0.15, 0.1), (0.1, 1.0, 10.0))
FAST = PronySeries((0.3,), (5e-3,))
MIXED = PronySeries((0.3, 0.2), (20e-3, 0.4))


PUSHED = np.array([[0.0, 0.0, -1.0]])


def reduced(n_modes, cache_dir):
    mesh = parametric_duct(DuctGeometry(4e-3, 30e-3, 12, 12))
    recipe = DuctRecipe(mesh, ShellSection(1e-3, 300e3, 0.45, 1060.0), (clamp(mesh),), n_modes, ElementChoice())
    return reduce_duct(recipe, 0.1, cache_dir)


def node_of(duct):
    return int(np.argmin(np.linalg.norm(duct.mesh.vertices_m - [20e-3, 0.0, 4e-3], axis=1)))


def loss_tangent(duct, series, frequency_hz):
    """Of the force at the end of each tick; what the start leaves dies away with the times of the series."""
    wall, angular = SqueezedWall(duct, None, np.array([node_of(duct)]), PUSHED, series), 2.0 * np.pi * frequency_hz
    ticks = int(max(1.3 / frequency_hz, 0.6) / DT_S)
    time_s = DT_S * np.arange(1, ticks + 1)
    force = np.array([wall.step(np.array([0.2e-3 * np.sin(angular * t)]))[0] for t in time_s])
    settled = time_s > 0.2
    left = [np.exp(-time_s / tau) for tau in series.tau_s]
    columns = np.stack([np.sin(angular * time_s), np.cos(angular * time_s), *left], axis=1)
    in_phase, ahead = np.linalg.lstsq(columns[settled], force[settled], rcond=None)[0][:2]
    return ahead / in_phase


def closed_form(duct, series, frequency_hz):
    """Of the modes, with their mass and damping and the complex modulus of the series, and of what they leave out."""
    angular, basis, node = 2.0 * np.pi * frequency_hz, duct.basis, np.array([node_of(duct)], np.int32)
    modulus = 1.0 - np.sum(np.array(series.g) / (1.0 + 1j * angular * np.array(series.tau_s)))
    shape, moved = PUSHED @ basis.Phi[node[0]], np.zeros((1, 3))
    duct.residual.apply(node, PUSHED, node, moved)
    damping = 2j * duct.damping_ratio * basis.omega_rad_s * angular
    compliance = np.sum(shape[0] ** 2 / (basis.omega_rad_s**2 * modulus + damping - angular**2))
    stiffness = 1.0 / (compliance + np.sum(moved * PUSHED) / modulus)
    return stiffness.imag / stiffness.real


@pytest.mark.parametrize("n_modes", [8, 60])
@pytest.mark.parametrize("series", [USUAL, FAST, MIXED], ids=["usual", "fast", "mixed"])
@pytest.mark.parametrize("frequency_hz", [0.2, 1.0, 5.0, 10.0])
def test_a_wall_moved_as_a_sine_has_the_loss_tangent_of_its_series(n_modes, series, frequency_hz, own_cache):
    duct = reduced(n_modes, own_cache / "bases")
    found, expected = loss_tangent(duct, series, frequency_hz), closed_form(duct, series, frequency_hz)
    print(f"{frequency_hz} Hz: {found:.5f} for {expected:.5f}")
    assert found == pytest.approx(expected, rel=0.02)


def test_an_elastic_wall_has_that_of_its_damping(own_cache):
    duct = reduced(8, own_cache / "bases")
    assert loss_tangent(duct, NEVER, 10.0) == pytest.approx(closed_form(duct, NEVER, 10.0), rel=0.02)
