"""Modes of shells that nothing holds, or too little: rigid motions at zero, then closed forms."""

import numpy as np
import pytest
from scipy.linalg import eigh

from tests.mechanics.reduction.dense_modes import condensed_stiffness
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp
from trocar.services.mechanics.fem.boundary_conditions import DOF_NAMES, held_dofs
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.fem.floating import compute_floating_modes, find_floating
from trocar.studies.published.shells import mapped_patch

ANDES = ElementChoice("andes", "dkt")
YOUNG, NU, THICKNESS = 2e9, 0.3, 0.01
SECTION = ShellSection(THICKNESS, YOUNG, NU, 1000.0)
PLATE_RAD_S = np.sqrt(YOUNG * THICKNESS**2 / (12.0 * (1.0 - NU**2) * 1000.0))
"""sqrt(D / rho h) of a plate with sides of 1 m."""


def modes_of(mesh, n_modes, supports=(), section=SECTION):
    floating = find_floating(mesh, held_dofs(mesh, supports))
    pins = [Support(np.array([dof // 6]), (DOF_NAMES[dof % 6],)) for dof in floating.pins]
    model = ShellModel(mesh, section, [*supports, *pins], ANDES)
    return model, compute_floating_modes(model, floating, n_modes), floating


def plate(n):
    return mapped_patch(n, n, lambda s, t: (s, t, 0.0 * s)).mesh


def test_a_free_square_plate():
    """Converged Ritz values of the completely free plate at Poisson's ratio 0.3 (unverified literature values)."""
    _, modes, _ = modes_of(plate(32), 11)
    assert modes.omega_rad_s[:6].tolist() == [0.0] * 6
    assert modes.omega_rad_s[6:] / PLATE_RAD_S == pytest.approx([13.468, 19.596, 24.270, 34.801, 34.801], rel=4e-3)


def test_a_free_ring_bends_as_rayleigh_s_does():
    """omega² = n² (n² - 1)² / (n² + 1) E I / (rho A R⁴), without extension; each twice."""
    radius, n = 0.2, np.array([2.0, 2.0, 3.0, 3.0])
    mesh = parametric_duct(DuctGeometry(radius, 0.004, 96, 1, wall_thickness_m=0.004))
    _, modes, floating = modes_of(mesh, 20, section=ShellSection(0.004, YOUNG, 0.0, 1000.0))
    assert len(floating.pins) == 6
    in_plane = [
        omega
        for omega, shape in zip(modes.omega_rad_s[6:], modes.Phi.transpose(2, 0, 1)[6:], strict=True)
        if np.abs(shape[:, 0]).max() < 0.1 * np.abs(shape).max()
    ]
    expected = n * (n**2 - 1.0) / np.sqrt(n**2 + 1.0) * np.sqrt(YOUNG * 0.004**2 / (12.0 * 1000.0)) / radius**2
    assert in_plane[:4] == pytest.approx(expected, rel=4e-3)


def test_modes_are_those_of_the_dense_stiffness_that_nobody_holds():
    """A bent tube; rotations condensed, eigenvalues of all translations, six of them nothing."""
    mesh = parametric_duct(DuctGeometry(0.05, 0.2, 8, 6, wall_thickness_m=0.01, curvature_1_m=3.0))
    model, modes, _ = modes_of(mesh, 14)
    unheld = ShellModel(mesh, SECTION, [clamp(mesh)], ANDES)
    unheld.held_dofs = np.zeros(0, np.int32)
    mass = np.repeat(model.mass_kg, 3)
    dense = eigh(condensed_stiffness(unheld), np.diag(mass), eigvals_only=True)
    assert modes.omega_rad_s[6:] ** 2 == pytest.approx(dense[6:14], rel=1e-6)
    assert abs(dense[:6]).max() < 1e-6 * dense[6]


def test_modes_are_mass_normalised_and_without_rigid_motion():
    mesh = parametric_duct(DuctGeometry(0.05, 0.2, 8, 6, wall_thickness_m=0.01))
    model, modes, floating = modes_of(mesh, 12)
    gram = np.einsum("n,nir,nis->rs", model.mass_kg, modes.Phi, modes.Phi)
    assert np.abs(gram - np.eye(12)).max() < 1e-9
    elastic = np.concatenate([modes.Phi, modes.rotations], axis=1)[..., 6:]
    force = model.K_full @ elastic.reshape(model.n_dofs, -1)
    inertia = np.zeros_like(elastic)
    inertia[:, :3] = model.mass_kg[:, None, None] * modes.Phi[..., 6:] * modes.omega_rad_s[6:] ** 2
    assert np.abs(force - inertia.reshape(model.n_dofs, -1)).max() < 1e-7 * np.abs(force).max()
    assert np.abs(model.K_full @ floating.motions).max() < 1e-9 * np.abs(model.K_full.data).max()


def test_a_plate_whose_rim_may_slide_keeps_three_rigid_motions():
    mesh = plate(24)
    rim = np.flatnonzero((np.abs(mesh.vertices_m[:, :2] - 0.5) > 0.5 - 1e-9).any(axis=1))
    _, modes, floating = modes_of(mesh, 6, [Support(rim, ("uz",))])
    assert len(floating.pins) == 3
    assert modes.omega_rad_s[:3].tolist() == [0.0] * 3
    assert modes.omega_rad_s[3:] / PLATE_RAD_S == pytest.approx(np.pi**2 * np.array([2.0, 5.0, 5.0]), rel=4e-3)


def test_each_piece_floats_by_itself():
    one = plate(6)
    vertices = np.vstack([one.vertices_m, one.vertices_m + np.array([3.0, 0.0, 0.0])])
    both = TriangleMesh(vertices, np.vstack([one.triangles, one.triangles + one.n_vertices]).astype(np.int32))
    _, alone, _ = modes_of(one, 8)
    _, modes, floating = modes_of(both, 16)
    assert len(floating.pins) == 12
    assert modes.omega_rad_s[12:] == pytest.approx(np.repeat(alone.omega_rad_s[6:], 2), rel=1e-6)


def test_what_is_held_does_not_float():
    mesh = parametric_duct(DuctGeometry(0.05, 0.2, 8, 6, wall_thickness_m=0.01))
    assert find_floating(mesh, held_dofs(mesh, [clamp(mesh)])).pins.size == 0
