"""Reduced dynamics against direct integration of the full duct."""

import numpy as np
import pytest
from scipy.sparse import csc_array, diags_array

from tests.by_day import by_day
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction import (
    ExactOscillator,
    ModalState,
    Newmark,
)
from trocar.studies.full_model import (
    CentralDifference,
    CondensedStiffness,
    DirectNewmark,
    modal_reaction,
    rayleigh_damping_ratio,
)

DT_S, STEPS = 1e-3, 500
# Tissue damps what is fast as well as what is slow: 10 % of critical in the first mode, loss factor 0.13 at 100 Hz.
BETA_S = 2e-4


def damping(basis, beta_s):
    """alpha and beta for 10 % of critical in the first mode."""
    first = basis.omega_rad_s[0]
    return 2.0 * 0.1 * first - beta_s * first**2, beta_s


def wall_node(mesh):
    return int(np.argmin(np.linalg.norm(mesh.vertices_m - [20e-3, 4e-3, 0.0], axis=1)))


def histories(model, duct, load, observed, beta_s, substeps):
    """Displacement of ``observed`` under a load for 0.25 s and after its release, full and reduced."""
    load_nodes, forces = load
    alpha, beta = damping(duct.basis, beta_s)
    full = DirectNewmark(model, DT_S / substeps, alpha, beta)
    reduced = ExactOscillator(duct.basis.omega_rad_s, rayleigh_damping_ratio(duct.basis.omega_rad_s, alpha, beta))
    state = ModalState.at_rest(duct.basis.n_modes)
    nodal = np.zeros((duct.basis.n_nodes, 3))
    nodal[load_nodes] = forces
    modal = np.einsum("nir,ni->r", duct.basis.Phi, nodal)
    out = np.empty((3, STEPS, len(observed), 3))
    for step in range(STEPS):
        on = float(step < STEPS // 2)
        for _ in range(substeps):
            full.step(on * nodal)
        reduced.predict(state, on * modal, DT_S)
        out[0, step] = full.displacements()[observed]
        out[1, step] = duct.basis.Phi[observed] @ state.q
        out[2, step] = duct.displacements(state.q, load_nodes, on * forces)[observed]
    return out


def largest_error(history, reference):
    scale = np.linalg.norm(reference, axis=2).max(axis=0)
    return np.linalg.norm(history - reference, axis=2).max(axis=0) / scale


@pytest.mark.parametrize("name", by_day(["wall"], ["tip"]))
def test_step_load_and_release_follow_the_full_model(model, duct, name):
    mesh = model.mesh
    observed = np.array([mesh.vertex_sets["mouth"][0], wall_node(mesh)], np.int32)
    loaded = {"wall": observed[1:], "tip": mesh.vertex_sets["mouth"]}[name]
    forces = np.tile([0.0, -2e-3 / len(loaded), 0.0], (len(loaded), 1))
    full, bare, reduced = histories(model, duct, (loaded, forces), observed, BETA_S, 6)
    errors, bare_errors = largest_error(reduced, full), largest_error(bare, full)
    print(f"load on {name}: worst error over 0.5 s at tip and wall {errors}, without residual {bare_errors}")
    assert errors.max() < 0.01
    if name == "wall":
        assert bare_errors[1] > 0.05


@pytest.mark.long
def test_with_the_papers_damping_what_rings_is_what_the_modes_leave_out(model, duct):
    # B = alpha M hardly damps the fast modes of the full model: they ring about the residual's static answer.
    observed = np.array([model.mesh.vertex_sets["mouth"][0], wall_node(model.mesh)], np.int32)
    load = observed[1:], np.array([[0.0, -2e-3, 0.0]])
    full, bare, reduced = histories(model, duct, load, observed, 0.0, 10)
    root_mean_square = [np.sqrt(np.mean(np.sum((h - full) ** 2, axis=2), axis=0)) for h in (reduced, bare)]
    scale = np.sqrt(np.mean(np.sum(full**2, axis=2), axis=0))
    print(f"B = alpha M: rms {root_mean_square[0] / scale}, worst {largest_error(reduced, full)}")
    assert (root_mean_square[0] / scale).max() < 0.01
    assert (root_mean_square[1] / scale)[1] > 0.05


def test_direct_newmark_conserves_energy_and_balances_forces(model):
    nodal = np.zeros((model.mesh.n_vertices, 3))
    nodal[wall_node(model.mesh)] = [0.0, 2e-3, 1e-3]
    full = DirectNewmark(model, DT_S)
    for _ in range(20):
        full.step(nodal)
    assert full.reaction_force() == pytest.approx(nodal, abs=1e-9 * 2e-3)
    before = full.energy_j()
    for _ in range(500):
        full.step(0.0 * nodal)
    after_first_free_step = full.energy_j()
    for _ in range(500):
        full.step(0.0 * nodal)
    assert full.energy_j() == pytest.approx(after_first_free_step, rel=1e-9)
    assert after_first_free_step > 0.01 * before


def test_reaction_force_of_a_damped_step_balances_the_load(model):
    nodal = np.zeros((model.mesh.n_vertices, 3))
    nodal[wall_node(model.mesh)] = [0.0, 2e-3, 1e-3]
    full = DirectNewmark(model, DT_S, alpha_1_s=12.0, beta_s=1e-4)
    for _ in range(50):
        full.step(nodal)
    assert full.reaction_force() == pytest.approx(nodal, abs=1e-9 * 2e-3)


def test_central_difference_agrees_with_newmark_below_its_limit(model):
    limit_s = CondensedStiffness(model).stable_step_s()
    dt_s = 1e-3 / int(np.ceil(1e-3 / limit_s))
    nodal = np.zeros((model.mesh.n_vertices, 3))
    nodal[model.mesh.vertex_sets["mouth"]] = [0.0, 1e-4, 0.0]
    explicit, implicit = CentralDifference(model, dt_s, 10.0), DirectNewmark(model, dt_s, 10.0)
    for _ in range(int(0.05 / dt_s)):
        explicit.step(nodal)
        implicit.step(nodal)
    tip = model.mesh.vertex_sets["mouth"][0]
    assert explicit.displacements()[tip] == pytest.approx(implicit.displacements()[tip], rel=5e-3, abs=1e-8)


def test_central_difference_refuses_a_step_beyond_its_limit_and_diverges_there(model):
    limit_s = CondensedStiffness(model).stable_step_s()
    with pytest.raises(ValueError, match="central difference is stable up to"):
        CentralDifference(model, 1.01 * limit_s)
    nodal = np.zeros((model.mesh.n_vertices, 3))
    nodal[wall_node(model.mesh)] = [0.0, 1e-3, 0.0]
    bounded = CentralDifference(model, 0.99 * limit_s)
    unbounded = CentralDifference(model, 0.99 * limit_s)
    unbounded._dt_s = 1.02 * limit_s
    for _ in range(400):
        bounded.step(nodal)
        unbounded.step(nodal)
    assert np.abs(bounded.u).max() < 0.1
    assert np.abs(unbounded.u).max() > 10.0


def test_reduced_reaction_force_is_the_full_one_for_a_load_within_the_modes(model, basis):
    weights = np.random.default_rng(4).standard_normal(basis.n_modes)
    nodal = model.mass_kg[:, None] * (basis.Phi @ weights)
    alpha = 2.0 * 0.1 * basis.omega_rad_s[0]
    zeta = rayleigh_damping_ratio(basis.omega_rad_s, alpha, 0.0)
    full, reduced = DirectNewmark(model, DT_S, alpha), Newmark(basis.omega_rad_s, zeta)
    state = ModalState.at_rest(basis.n_modes)
    for _ in range(40):
        full.step(nodal)
        reduced.predict(state, np.einsum("nir,ni->r", basis.Phi, nodal), DT_S)
    # The paper's step 4 prints Phi f, which is no force: as Phi^T M Phi = 1, it is M Phi that undoes f = Phi^T F.
    reaction = model.mass_kg[:, None] * (basis.Phi @ modal_reaction(state, basis.omega_rad_s, zeta))
    assert reaction == pytest.approx(nodal, abs=1e-9 * np.abs(nodal).max())
    assert reaction == pytest.approx(full.reaction_force(), abs=1e-8 * np.abs(nodal).max())


def test_no_mode_is_missing_below_the_highest_one(model, basis):
    """Sylvester's law of inertia: as many negative pivots of K - s M as modes below sqrt(s), double ones counted."""
    shift = (basis.omega_rad_s[-1] * (1.0 + 1e-6)) ** 2
    factor = factorise(csc_array(model.K_free - shift * diags_array(model.free_mass_kg)))
    assert np.array_equal(factor.perm_r, factor.perm_c)
    assert np.sum(factor.U.diagonal() < 0.0) == basis.n_modes
