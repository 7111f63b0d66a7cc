"""Natural modes against condensation, published frequencies, scaling laws and an independent solver."""

import math

import numpy as np
import pytest

from tests.by_day import by_day
from tests.mechanics.reduction.dense_modes import compute_modes_dense, condensed_stiffness
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp, compute_modes
from trocar.services.mechanics.fem.elements import cst
from trocar.studies.published import opensees as opensees_check
from trocar.studies.published.shells import (
    DUCT_RITZ_HZ,
    plate_frequencies,
    reference_duct,
    sorted_duct_frequencies_hz,
)

CST, ANDES = ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")


@pytest.fixture(scope="module")
def small():
    return reference_duct(12, 14, CST)


def test_sparse_modes_are_the_modes_of_the_condensed_stiffness(small):
    """Massless rotations in the sparse problem are the paper's equations 15 and 16."""
    sparse, dense = compute_modes(small, 20), compute_modes_dense(small, 20)
    assert sparse.omega_rad_s == pytest.approx(dense.omega_rad_s, rel=1e-9)
    t = small.free_dofs[small.free_translations]
    node, component = t // 6, t % 6
    shapes = sparse.Phi[node, component]
    residual = condensed_stiffness(small) @ shapes - sparse.omega_rad_s**2 * (small.mass_kg[node, None] * shapes)
    assert np.abs(residual).max() < 1e-8 * np.abs(condensed_stiffness(small) @ shapes).max()


def test_modes_are_mass_normalised_and_orthogonal(small):
    modes = compute_modes(small, 20)
    gram = np.einsum("n,nir,nis->rs", small.mass_kg, modes.Phi, modes.Phi)
    assert np.abs(gram - np.eye(20)).max() < 1e-10
    assert np.abs(modes.Phi[small.mesh.vertex_sets["clamped"]]).max() == 0.0


def test_rotations_belong_to_their_translations(small):
    """K u = omega² M u over all free dofs, so rotational rows are in balance without inertia."""
    modes = compute_modes(small, 6)
    u = np.concatenate([modes.Phi, modes.rotations], axis=1).reshape(small.n_dofs, -1)[small.free_dofs]
    inertia = small.free_mass_kg[:, None] * u * modes.omega_rad_s**2
    assert np.abs(small.K_free @ u - inertia).max() < 1e-8 * np.abs(small.K_free @ np.abs(u)).max()


def test_penalty_gives_the_same_frequencies(small):
    penalty = ShellModel(small.mesh, small.section, [clamp(small.mesh)], CST, "penalty")
    assert compute_modes(penalty, 8).omega_rad_s == pytest.approx(compute_modes(small, 8).omega_rad_s, rel=1e-6)


@pytest.mark.parametrize("elements", [CST, ANDES], ids=str)
def test_reference_duct_first_eight_frequencies(elements):
    """Case A within 1.5 % of the Sanders-shell Ritz values, doubles counted twice."""
    found = compute_modes(reference_duct(24, 36, elements), 8).frequency_hz
    assert found == pytest.approx(sorted_duct_frequencies_hz()[:8], rel=0.015)


@pytest.mark.parametrize("elements", by_day([ANDES], [CST]), ids=str)
def test_reference_duct_converges(elements):
    """The first 24 frequencies (up to five axial half waves) within 1 % at a fine mesh."""
    found = compute_modes(reference_duct(60, 90, elements), 24).frequency_hz
    assert found == pytest.approx(sorted_duct_frequencies_hz()[:24], rel=0.01)


def first_ovalling_frequency_hz(n):
    """Lowest mode whose mouth moves radially in two waves round the rim."""
    model = reference_duct(n, 3 * n // 2, CST)
    modes = compute_modes(model, 7)
    mouth = model.mesh.vertex_sets["mouth"]
    outward = model.mesh.vertices_m[mouth] * [0, 1, 1] / 4e-3
    radial = np.einsum("nir,ni->nr", modes.Phi[mouth], outward)
    two_waves = np.abs(np.fft.rfft(radial, axis=0)[2])
    return modes.frequency_hz[np.flatnonzero(two_waves > 0.5 * two_waves.max())[0]]


def test_ovalling_frequency_converges_with_the_square_of_the_mesh_size():
    n = np.array([16, 24, 36, 48])
    error = [abs(first_ovalling_frequency_hz(k) / DUCT_RITZ_HZ["(2,1)"] - 1) for k in n]
    assert -np.polyfit(np.log(n), np.log(error), 1)[0] == pytest.approx(2.0, abs=0.25)


def test_plate_frequencies_converge_with_the_square_of_the_mesh_size():
    """Simply supported square plate against pi² (m² + n²)."""
    exact = math.pi**2 * np.array([2, 5, 5, 8, 10, 10])
    n = np.array([8, 16, 32])
    error = [np.abs(plate_frequencies(k, False, CST) / exact - 1).max() for k in n]
    assert -np.polyfit(np.log(n), np.log(error), 1)[0] == pytest.approx(2.0, abs=0.2)
    assert error[-1] < 0.01


def test_double_modes_are_double(small):
    frequency = compute_modes(small, 2).frequency_hz
    assert frequency[1] == pytest.approx(frequency[0], rel=1e-9)


def test_frequency_scales_with_the_root_of_modulus_over_density(small):
    stiffer = ShellSection(0.5e-3, 4 * 100e3, 0.45, 1060.0 / 4)
    model = ShellModel(small.mesh, stiffer, [clamp(small.mesh)], CST)
    assert compute_modes(model, 8).omega_rad_s == pytest.approx(4 * compute_modes(small, 8).omega_rad_s, rel=1e-9)


def test_fictitious_drilling_stiffness_hardly_matters(monkeypatch):
    usual = compute_modes(reference_duct(24, 36, CST), 8).frequency_hz
    for factor in (0.1, 10.0):
        monkeypatch.setattr(cst, "DRILLING_PENALTY", 1e-3 * factor)
        assert compute_modes(reference_duct(24, 36, CST), 8).frequency_hz == pytest.approx(usual, rel=1e-3)


def test_more_modes_than_translations_are_refused(small):
    with pytest.raises(ValueError, match="n_modes must lie between 1 and"):
        compute_modes(small, 10**6)


@pytest.fixture(scope="module")
def opensees():
    try:
        return opensees_check.load_opensees()
    except ImportError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def opensees_frequencies_hz(opensees):
    """Theirs take our mesh and section, not our elements."""
    model = reference_duct(36, 54, CST)
    return opensees_check.opensees_frequencies_hz(model, model.mesh.vertex_sets["clamped"], 8)


@pytest.mark.parametrize("elements", [CST, ANDES], ids=str)
def test_independent_solver_agrees_on_the_same_mesh(elements, opensees_frequencies_hz):
    found = compute_modes(reference_duct(36, 54, elements), 8).frequency_hz
    assert found == pytest.approx(opensees_frequencies_hz, rel=0.01)


def test_independent_solver_agrees_on_a_pinch(opensees):
    """Two opposite forces across the mouth, the load a forceps makes."""
    model = reference_duct(40, 60, ANDES)
    mouth = model.mesh.vertex_sets["mouth"]
    load = np.zeros((model.mesh.n_vertices, 3))
    load[mouth[0], 1], load[mouth[20], 1] = -1e-3, 1e-3
    theirs = opensees_check.opensees_displacement_m(model, model.mesh.vertex_sets["clamped"], load)
    ours = model.solve_static(load).displacement_m
    assert np.abs(ours - theirs).max() < 0.01 * np.abs(theirs).max()
