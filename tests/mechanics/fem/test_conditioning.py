"""Solutions of badly conditioned shells: healed where that is possible, refused with the cause where it is not."""

import numpy as np
import pytest

from trocar.services.mechanics.fem import ShellModel, ShellSection, Support, clamp, compute_modes
from trocar.services.mechanics.fem.boundary_conditions import rigid_body_modes
from trocar.services.mechanics.fem.conditioning import IllConditionedError, condition_estimate, internal_forces
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

MESH = parametric_duct(DuctGeometry(4e-3, 40e-3, 16, 20))
CENTRE_X = MESH.vertices_m[MESH.triangles].mean(axis=1)[:, 0]
LOAD = np.zeros((MESH.n_vertices, 3))
LOAD[MESH.vertex_sets["mouth"], 1] = 1e-3 / 16


def model(ratio=1.0, constraints="elimination", thickness=5e-4):
    """The reference duct with a middle third that is ``ratio`` times stiffer and floats between soft wall."""
    modulus = np.where(np.abs(CENTRE_X - 0.02) < 0.007, 1e5 * ratio, 1e5)
    return ShellModel(MESH, ShellSection(thickness, modulus, 0.45, 1060.0), [clamp(MESH)], constraints=constraints)


def unbalanced(solution):
    """Force and moment about the origin of load and reactions together, over the load's."""
    reaction = solution.reaction
    force = reaction[:, :3] + LOAD
    moment = np.cross(MESH.vertices_m, force) + reaction[:, 3:]
    return np.linalg.norm(force.sum(axis=0)) / 1e-3, np.linalg.norm(moment.sum(axis=0)) / 4e-5


@pytest.mark.parametrize("constraints", ["elimination", "penalty"])
@pytest.mark.parametrize("ratio", [1e6, 1e8])
def test_a_piece_far_stiffer_than_what_holds_it_moves_as_a_rigid_one(ratio, constraints):
    """The assembled matrix alone leaves the reaction off by 2e-5 of the load at 1e8, and by a sixth at 1e12."""
    almost_rigid = model(1e4).solve_static(LOAD)
    solution = model(ratio, constraints).solve_static(LOAD)
    assert solution.residual < 1e-8
    assert max(unbalanced(solution)) < 1e-8
    difference = np.abs(solution.displacement_m - almost_rigid.displacement_m).max()
    assert difference < 1e-4 * np.abs(solution.displacement_m).max()


def test_what_no_refinement_heals_is_refused_with_the_ratio_and_both_places():
    with pytest.raises(
        IllConditionedError,
        match=r"residual stays at .* of the load .* spans 1e\+12, from triangle \d+ at \[.*\] mm \(1e\+17 Pa, 0.5"
        r" mm thick.* to triangle \d+ at \[.*\] mm \(1e\+05 Pa",
    ):
        model(1e12).solve_static(LOAD)


def test_modes_of_a_model_without_digits_are_refused():
    assert compute_modes(model(1e4), 2).omega_rad_s[0] > 0.0
    with pytest.raises(IllConditionedError, match=r"leaves no digits: stiffness of the triangles spans 1e\+12"):
        compute_modes(model(1e12), 2)


def test_internal_forces_are_those_of_the_matrix():
    duct = model()
    u = 1e-3 * np.random.default_rng(1).standard_normal(duct.n_dofs)
    expected = duct.K_full @ u
    assert internal_forces(duct, u.astype(np.longdouble)) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="this machine has no extended precision")
def test_internal_forces_of_a_rigid_motion_are_none():
    duct = model(1e12)
    rigid = rigid_body_modes(MESH.vertices_m, np.zeros(3)).reshape(-1, 6) @ np.array([1.0, 2, 3, 4, 5, 6]) * 1e-3
    size = (abs(duct.K_full) @ np.abs(rigid)).max()
    assert np.abs(internal_forces(duct, rigid.astype(np.longdouble))).max() < 1e-15 * size


def test_the_condition_is_that_of_the_scaled_matrix():
    duct = model(100.0)
    K = duct.K_free.toarray()
    scale = 1.0 / np.sqrt(np.diag(K))
    exact = np.linalg.cond(scale[:, None] * K * scale, 1)
    assert exact / 3.0 < condition_estimate(duct) <= exact * 1.01


def test_a_thin_wall_is_not_mistaken_for_a_bad_one():
    solution = model(thickness=4e-3 / 500).solve_static(LOAD)
    assert solution.residual < 1e-11
    assert max(unbalanced(solution)) < 1e-10


def test_a_rigid_motion_imposed_on_every_support_leaves_no_force():
    held = [Support(MESH.vertex_sets[name]) for name in ("clamped", "mouth")]
    imposed = np.zeros((MESH.n_vertices, 6))
    imposed[:, 1] = 1e-3
    duct = ShellModel(MESH, ShellSection(5e-4, 1e5, 0.45, 1060.0), held)
    solution = duct.solve_static(np.zeros((MESH.n_vertices, 3)), imposed)
    assert solution.residual < 1e-8
    assert solution.displacement_m[:, 1] == pytest.approx(np.full(MESH.n_vertices, 1e-3), rel=1e-9)
