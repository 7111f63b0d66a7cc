"""Nonlinear membrane: the full energy, its reduction, a closed-form stiffening, and full against reduced."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator, cg

from tests.mechanics.reduction.exact_membrane import ExactMembrane
from tests.mechanics.reduction.modal_derivatives import (
    cubic_force,
    extend_with_derivatives,
    modal_derivatives,
)
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp
from trocar.services.mechanics.fem.frames import local_coordinates, local_frames
from trocar.services.mechanics.fem.section import Orthotropy
from trocar.services.mechanics.reduction import ExactOscillator, ModalBasis, ModalState
from trocar.services.mechanics.reduction.build import build_basis
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.nonlinear.membrane import product_strain
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial
from trocar.services.mechanics.reduction.nonlinear.quadratic_manifold import relaxed_membrane_force
from trocar.services.mechanics.reduction.wall_step.implicit_step import WallStep, held_force, wall_energy, wall_force
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import alternating_triangles

LENGTH, WIDTH, THICKNESS, E = 1.0, 0.1, 0.01, 1e7

# Lowest modes of the duct that take part. Most modes of a tube are double, and how a double pair is turned in its
# plane, like the sign of a mode, is the eigensolver's choice: a number that parts a pair, or a state drawn in modal
# coordinates, would make the answer depend on the machine.
N_COORDINATES, N_DIFFERENTIATED, N_DERIVATIVES = 19, 7, 13


def hinged_beam(membrane: str) -> ShellModel:
    """A strip on immovable hinges at both ends."""
    x, y = np.meshgrid(np.linspace(0.0, LENGTH, 41), np.linspace(0.0, WIDTH, 3), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    grid = np.arange(x.size).reshape(x.shape)
    hinges = Support(np.concatenate([grid[0], grid[-1]]), ("ux", "uy", "uz"))
    mesh = TriangleMesh(vertices, alternating_triangles(grid), {})
    return ShellModel(mesh, ShellSection(THICKNESS, E, 0.0, 1000.0), [hinges], ElementChoice(membrane, "dkt"))


@pytest.fixture(scope="module")
def beam() -> ShellModel:
    return hinged_beam("andes")


@pytest.fixture(scope="module")
def nonlinear_duct(model, basis):
    nonlinear = extend_with_derivatives(model, basis, N_DIFFERENTIATED, N_DERIVATIVES)
    return nonlinear, cubic_force(ExactMembrane.from_model(model), nonlinear)


def energy_j(polynomial, q):
    wall = WallStep.of(np.ones(q.size), polynomial=polynomial)
    return wall_energy(wall.address, q)


def slope(polynomial, q):
    wall, out = WallStep.of(np.ones(q.size), polynomial=polynomial), np.zeros(q.size)
    wall_force(wall.address, q, out)
    return -out


def some_displacement(model, size_m=1e-3):
    return size_m * np.random.default_rng(8).standard_normal((model.mesh.n_vertices, 3))


def some_coordinates(nonlinear, size_m=2e-3):
    q = np.zeros(nonlinear.basis.n_modes)
    active = nonlinear.coordinates
    q[active] = np.random.default_rng(9).standard_normal(active.size) / nonlinear.basis.omega_rad_s[active]
    return q * size_m / np.abs(nonlinear.basis.displacements(q)).max()


def test_force_is_the_gradient_of_the_energy(model):
    membrane, u = ExactMembrane.from_model(model), some_displacement(model)
    direction = some_displacement(model, 1.0)[::-1]
    step = 1e-7
    difference = (membrane.energy_j(u + step * direction) - membrane.energy_j(u - step * direction)) / (2.0 * step)
    assert np.sum(membrane.force_n(u) * direction) == pytest.approx(difference, rel=1e-7)


def test_bilinear_form_is_the_quadratic_part_of_the_force(model):
    membrane, u = ExactMembrane.from_model(model), some_displacement(model)
    even = 0.5 * (membrane.force_n(u) + membrane.force_n(-u))
    assert membrane.quadratic_force_n(u, u) == pytest.approx(even, abs=1e-12 * np.abs(even).max())


def test_a_rigid_rotation_stores_no_membrane_energy(model):
    # The linear membrane's energy of a finite rotation is false; linear plus the rest is St. Venant-Kirchhoff, exact.
    membrane, mesh = ExactMembrane.from_model(model), model.mesh
    turn = np.linalg.qr(np.random.default_rng(10).standard_normal((3, 3)))[0]
    u = mesh.vertices_m @ (turn.T - np.eye(3))
    frames = local_frames(mesh)
    assert membrane.gradients.shape == (mesh.n_triangles, 2, 3)
    assert local_coordinates(mesh, frames).shape == (mesh.n_triangles, 3, 2)
    e = product_strain(membrane.tangents, membrane._displacement_gradients(u))
    linear = 0.5 * np.einsum("mi,mij,mj->", e, membrane.rigidity_n_m, e)
    assert abs(linear + membrane.energy_j(u)) < 1e-12 * linear


def test_polynomial_equals_the_full_force_and_energy_on_the_basis(model, nonlinear_duct):
    nonlinear, cubic = nonlinear_duct
    membrane, q = ExactMembrane.from_model(model), some_coordinates(nonlinear)
    out, u = slope(cubic, q), nonlinear.basis.displacements(q)
    full = np.einsum("nir,ni->r", nonlinear.basis.Phi, membrane.force_n(u))[nonlinear.coordinates]
    assert out[nonlinear.coordinates] == pytest.approx(full, abs=1e-11 * np.abs(full).max())
    assert energy_j(cubic, q) == pytest.approx(membrane.energy_j(u), rel=1e-11)


def test_polynomial_force_is_the_gradient_of_the_full_energy_by_differences(model, nonlinear_duct):
    nonlinear, cubic = nonlinear_duct
    membrane, q = ExactMembrane.from_model(model), some_coordinates(nonlinear)
    out = slope(cubic, q)
    for mode in nonlinear.coordinates[[0, 5, 12, 19]]:
        step = np.zeros(q.size)
        step[mode] = 1e-4 * np.linalg.norm(q)
        sides = [membrane.energy_j(nonlinear.basis.displacements(q + sign * step)) for sign in (1.0, -1.0)]
        assert out[mode] == pytest.approx((sides[0] - sides[1]) / (2.0 * step[mode]), rel=1e-5)


def test_extended_basis_is_orthonormal_and_diagonal(model, basis, nonlinear_duct):
    extended = nonlinear_duct[0].basis
    gram = np.einsum("nir,n,nis->rs", extended.Phi, model.mass_kg, extended.Phi)
    assert gram == pytest.approx(np.eye(extended.n_modes), abs=1e-10)
    assert extended.n_modes == basis.n_modes + N_DERIVATIVES
    assert np.all(np.diff(extended.omega_rad_s) >= 0.0)
    assert set(np.round(basis.omega_rad_s, 6)) <= set(np.round(extended.omega_rad_s, 6))


def test_modal_derivatives_are_the_second_derivative_of_the_full_equilibrium(beam):
    # Loads K phi a: u = phi a + psi a^2 / 2 + O(a^3), by a full nonlinear solve at +a and -a.
    basis, membrane = build_basis(beam, 4), ExactMembrane.from_model(beam)
    derivative = modal_derivatives(beam, basis, 1)[:, :, 0] * basis.omega_rad_s[0] ** 4
    a = 2e-4 / np.abs(basis.Phi[:, :, 0]).max()
    load = a * basis.omega_rad_s[0] ** 2 * beam.mass_kg[:, None] * basis.Phi[:, :, 0]
    even = 0.5 * (solve_full(beam, membrane, load) + solve_full(beam, membrane, -load))
    assert even == pytest.approx(0.5 * a**2 * derivative, abs=0.01 * np.abs(even).max())


def solve_full(model, membrane, load_n, steps=8):
    """Newton's method on K u + f(u) = load in load steps; the tangent acts by differences in conjugate gradients."""
    u = np.zeros(len(model.free_dofs))
    size = u.size
    preconditioner = LinearOperator((size, size), matvec=model.factor.solve, dtype=float)

    def internal(v):
        return model.K_free @ v + free_load(model, membrane.force_n(nodal_translations(model, v)))

    for fraction in np.linspace(1.0 / steps, 1.0, steps):
        target = fraction * free_load(model, load_n)
        for _ in range(30):
            unbalanced = target - internal(u)
            if np.linalg.norm(unbalanced) < 1e-9 * np.linalg.norm(target):
                break

            def tangent(direction, at=u):
                step = 1e-6 * max(np.linalg.norm(at), 1e-6) / np.linalg.norm(direction)
                return (internal(at + step * direction) - internal(at - step * direction)) / (2.0 * step)

            change, failed = cg(
                LinearOperator((size, size), matvec=tangent, dtype=float), unbalanced, rtol=1e-5, M=preconditioner
            )
            assert not failed
            u = u + change
        else:
            raise AssertionError("Newton's method did not converge")
    return nodal_translations(model, u)


def solve_reduced(nonlinear, cubic, modal_load):
    """The same by Newton's method on the reduced polynomial."""
    omega, q = nonlinear.basis.omega_rad_s, np.zeros(nonlinear.basis.n_modes)

    def internal(x):
        out = omega**2 * x
        out += slope(cubic, x)
        return out

    for fraction in np.linspace(0.1, 1.0, 10):
        for _ in range(20):
            tangent = np.diag(omega**2)
            for mode in nonlinear.coordinates:
                step = np.zeros(q.size)
                step[mode] = 1e-6 / omega[0]
                tangent[:, mode] = (internal(q + step) - internal(q - step)) / (2.0 * step[mode])
            q = q + np.linalg.solve(tangent, fraction * modal_load - internal(q))
    assert np.linalg.norm(internal(q) - modal_load) < 1e-8 * np.linalg.norm(modal_load)
    return q


def test_hinged_beam_stiffens_as_the_closed_form(beam):
    """w = a sin(pi x / L) between immovable hinges: energy = pi^4 EI a^2 / (4 L^3) + pi^4 EA a^4 / (32 L^3)."""
    linear = build_basis(beam, 6)
    shapes = np.abs(linear.Phi[:, 2, :]).max(axis=0) > np.abs(linear.Phi[:, 1, :]).max(axis=0)
    assert shapes[0]
    nonlinear = extend_with_derivatives(beam, linear, 1, 1)
    cubic = cubic_force(ExactMembrane.from_model(beam), nonlinear)
    peak = np.abs(nonlinear.basis.Phi[:, 2, 0]).max()
    EA, EI = E * WIDTH * THICKNESS, E * WIDTH * THICKNESS**3 / 12.0
    for amplitude in (0.5 * THICKNESS, 2.0 * THICKNESS, 5.0 * THICKNESS):
        bending = np.pi**4 * EI * amplitude**2 / (4.0 * LENGTH**3)
        stretching = np.pi**4 * EA * amplitude**4 / (32.0 * LENGTH**3)
        q = np.zeros(nonlinear.basis.n_modes)
        q[0] = amplitude / peak
        locked = energy_j(cubic, q)
        other = nonlinear.coordinates[nonlinear.coordinates != 0][0]
        scale = amplitude**2 / LENGTH / np.abs(nonlinear.basis.Phi[:, 0, other]).max()
        energies = []
        for trial in (-scale, 0.0, scale):
            q[other] = trial
            energies.append(energy_j(cubic, q) + 0.5 * (nonlinear.basis.omega_rad_s[other] * trial) ** 2)
        # Exactly quadratic in the derivative's coordinate apart from a term of higher order in slope.
        curvature = energies[0] - 2.0 * energies[1] + energies[2]
        relaxed = energies[1] - (energies[2] - energies[0]) ** 2 / (8.0 * curvature)
        assert 0.5 * (nonlinear.basis.omega_rad_s[0] * amplitude / peak) ** 2 == pytest.approx(bending, rel=5e-3)
        assert relaxed == pytest.approx(stretching, rel=0.02)
        assert locked > 1.2 * stretching


def test_reduced_beam_follows_the_full_nonlinear_solution(beam):
    linear = build_basis(beam, 12)
    nonlinear = extend_with_derivatives(beam, linear, 8, 12)
    membrane = ExactMembrane.from_model(beam)
    cubic = cubic_force(membrane, nonlinear)
    load = np.zeros((beam.mesh.n_vertices, 3))
    load[:, 2] = 1.5 * beam.mass_kg / beam.mass_kg.sum()
    full = solve_full(beam, membrane, load)
    q = solve_reduced(nonlinear, cubic, np.einsum("nir,ni->r", nonlinear.basis.Phi, load))
    reduced, middle = nonlinear.basis.displacements(q), 61
    linear_answer = beam.solve_static(load).displacement_m
    print(
        f"middle: full {full[middle, 2]:.4f}, reduced {reduced[middle, 2]:.4f}, linear {linear_answer[middle, 2]:.4f}"
    )
    assert linear_answer[middle, 2] > 2.0 * full[middle, 2]
    assert reduced == pytest.approx(full, abs=0.01 * np.abs(full).max())


@pytest.fixture(scope="module")
def cst_model(model):
    mesh = model.mesh
    return ShellModel(mesh, model.section, [clamp(mesh)], ElementChoice("cst", "dkt"))


@pytest.fixture(scope="module")
def relaxed(cst_model, basis) -> MembranePolynomial:
    return relaxed_membrane_force(cst_model, basis, N_COORDINATES)


def test_relaxed_beam_has_the_closed_form_energy():
    """The same hinged beam: after relaxation its quartic energy is pi^4 EA a^4 / (32 L^3) at any amplitude."""
    beam = hinged_beam("cst")
    basis = build_basis(beam, 6)
    relaxed = relaxed_membrane_force(beam, basis, 1)
    peak = np.abs(basis.Phi[:, 2, 0]).max()
    for amplitude in (THICKNESS, 10.0 * THICKNESS):
        q = np.zeros(6)
        q[0] = amplitude / peak
        expected = np.pi**4 * E * WIDTH * THICKNESS * amplitude**4 / (32.0 * LENGTH**3)
        assert energy_j(relaxed, q) == pytest.approx(expected, rel=0.01)


def test_relaxed_energy_is_never_negative(basis, relaxed):
    worst = largest_of_cubic(relaxed, basis, N_COORDINATES)
    print(f"largest W3^2 / (4 W2 W4): {worst}")
    assert 0.5 < worst <= 1.0 + 1e-6


@pytest.mark.parametrize("membrane", ["andes", "cst"])
def test_nor_is_that_of_a_thin_wall_that_is_stiffer_round_than_along(model, membrane):
    """Strains of a stiffer element than the modes have: the energy fell without end, and a duct grew to 0.3 m."""
    orthotropy = Orthotropy(np.array([1.0, 0.0, 0.0]), 6.0, 0.34)
    section = replace(model.section, thickness_m=0.1e-3, poisson_ratio=0.15, orthotropy=orthotropy)
    of_modes, of_strain = (
        ShellModel(model.mesh, section, [clamp(model.mesh)], ElementChoice(each, "dkt")) for each in (membrane, "cst")
    )
    basis = build_basis(of_modes, 12)
    force = relaxed_membrane_force(of_strain, basis, 12)
    assert largest_of_cubic(force, basis, 12) <= 1.0 + 1e-6


def largest_of_cubic(force, basis, n_coordinates):
    """Largest W3^2 / (4 W2 W4): up to 1, W2 + W3 + W4 >= 0 along every direction, at the amplitude of the least."""
    rng, worst = np.random.default_rng(11), 0.0
    for _ in range(3000):
        q = np.zeros(basis.n_modes)
        chosen = rng.choice(n_coordinates, rng.integers(1, n_coordinates), replace=False)
        q[chosen] = rng.standard_normal(chosen.size) / basis.omega_rad_s[chosen] ** 2
        q /= np.sqrt(0.5 * np.sum((basis.omega_rad_s * q) ** 2))
        third = 0.5 * (energy_j(force, q) - energy_j(force, -q))
        fourth = 0.5 * (energy_j(force, q) + energy_j(force, -q))
        assert fourth > 0.0
        worst = max(worst, third**2 / (4.0 * fourth))
    return worst


def free_vibration(force, basis, q, dt_s, duration_s):
    """Energies after each step, and where it ends."""
    n_modes, none = basis.n_modes, np.zeros(basis.n_modes)
    omega = basis.omega_rad_s
    wall, linear_step = WallStep.of(omega**2, polynomial=force), ExactOscillator(omega, none)
    wall.take_gain(linear_step.gains(dt_s).position)
    state, held, energies = ModalState(q.copy(), np.zeros(n_modes), np.zeros(n_modes)), np.zeros(n_modes), []
    for _ in range(round(duration_s / dt_s)):
        ahead = state.copy()
        linear_step.predict(ahead, none, dt_s)
        held_force(wall.address, state.q, ahead.q, held)
        linear_step.predict(state, held, dt_s)
        strain = state.strain_energy_j(omega) + energy_j(force, state.q)
        energies.append(state.kinetic_energy_j() + strain)
    return np.array(energies), state.q


def pinched_askew(model, basis, size_m, n_modes=N_COORDINATES):
    """Static shape, in the lowest modes, under two forces on the mouth that no plane of symmetry holds.

    Given by forces and not by coordinates: whatever way double modes are turned, it is the same displacement.
    """
    mouth, load = model.mesh.vertex_sets["mouth"], np.zeros((model.mesh.n_vertices, 3))
    load[mouth[0]], load[mouth[7]] = [0.0, -1.0, 0.0], [0.0, 0.3, 1.0]
    q = np.einsum("nir,ni->r", basis.Phi, load) / basis.omega_rad_s**2
    q[n_modes:] = 0.0
    return q * size_m / np.abs(basis.displacements(q)).max()


def with_double_modes_turned(basis):
    """The same modes as another machine may find them: pairs turned in their plane, single ones with the other sign."""
    rng, omega, Phi, k = np.random.default_rng(12), basis.omega_rad_s, basis.Phi.copy(), 0
    while k < omega.size:
        is_double = k + 1 < omega.size and omega[k + 1] < (1.0 + 1e-6) * omega[k]
        angle = rng.uniform(0.0, 2.0 * np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) if is_double else -np.eye(1)
        Phi[:, :, k : k + len(turn)] = Phi[:, :, k : k + len(turn)] @ turn
        k += len(turn)
    return ModalBasis.from_modes(omega, Phi)


def test_the_energy_does_not_depend_on_how_double_modes_are_turned(cst_model, basis, relaxed):
    other = with_double_modes_turned(basis)
    q, q_other = (pinched_askew(cst_model, each, 6e-3) for each in (basis, other))
    assert np.abs(q - q_other).max() > 0.5 * np.abs(q).max()
    assert other.displacements(q_other) == pytest.approx(basis.displacements(q), abs=1e-12)
    again = relaxed_membrane_force(cst_model, other, N_COORDINATES)
    assert energy_j(again, q_other) == pytest.approx(energy_j(relaxed, q), rel=1e-9)


def test_a_wall_that_swings_keeps_its_energy_and_its_step_is_of_second_order(cst_model, basis, relaxed):
    q = pinched_askew(cst_model, basis, 6e-3)
    assert energy_j(relaxed, q) > 0.1 * 0.5 * np.sum((basis.omega_rad_s * q) ** 2)
    ends = []
    for dt_s in (1e-3, 5e-4, 2.5e-4):
        energies, end = free_vibration(relaxed, basis, q, dt_s, 0.1)
        assert np.ptp(energies) < 2e-3 * energies.mean()
        ends.append(end)
    far, near = (np.linalg.norm(basis.omega_rad_s * (one - other)) for one, other in pairwise(ends))
    assert np.log2(far / near) == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("size_m", [6e-3, 12e-3])
def test_nor_does_it_run_away_in_steps_of_a_millisecond(cst_model, basis, relaxed, size_m):
    energies, _ = free_vibration(relaxed, basis, pinched_askew(cst_model, basis, size_m), 1e-3, 2.0)
    assert np.ptp(energies) < 0.01 * energies.mean()


def test_nor_with_derivatives_as_coordinates_which_are_stiff(model, nonlinear_duct):
    """Kicks of a millisecond gained ten times the energy in 10 ms."""
    nonlinear, cubic = nonlinear_duct
    q = pinched_askew(model, nonlinear.basis, 4e-3, n_modes=nonlinear.basis.n_modes)
    energies, _ = free_vibration(cubic, nonlinear.basis, q, 1e-3, 0.1)
    assert np.ptp(energies) < 0.02 * energies.mean()


def test_only_the_cst_membrane_can_be_relaxed(model, basis):
    with pytest.raises(ValueError, match="needs the element 'cst', not 'andes'"):
        relaxed_membrane_force(model, basis, 5)
