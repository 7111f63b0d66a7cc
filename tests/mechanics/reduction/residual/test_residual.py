"""Residual compliance: static answers equal the full model's; patches approach it; kernels agree with algebra."""

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.mechanics.reduction.residual.node_blocks import between_nodes
from trocar.services.mechanics.reduction import ModalState, ReducedDuct, Residual
from trocar.services.mechanics.reduction.basis import gather_modes
from trocar.services.mechanics.reduction.build import residual_response
from trocar.services.mechanics.reduction.residual.patch_error import PatchError, measure_patches
from trocar.services.mechanics.reduction.residual.patches import (
    build_patches,
    colour_apart,
    largest_radius_m,
    patch_pattern,
)
from trocar.services.mechanics.reduction.residual.selected_inverse import SelectedInverse
from trocar.services.mechanics.surface.mesh import vertex_adjacency, vertex_normals


def opposite_node(mesh, node):
    """The node across the lumen, on a straight duct along x."""
    mirrored = mesh.vertices_m[node] * [1.0, -1.0, -1.0]
    return int(np.argmin(np.linalg.norm(mesh.vertices_m - mirrored, axis=1)))


def static_answer(duct: ReducedDuct, forces_n):
    loaded = np.flatnonzero(np.any(forces_n != 0.0, axis=1)).astype(np.int32)
    modal_force = np.einsum("nir,ni->r", duct.basis.Phi, forces_n)
    state = ModalState.at_rest(duct.basis.n_modes)
    state.q[:] = modal_force / duct.basis.omega_rad_s**2
    return duct.displacements(state.q, loaded, forces_n[loaded])


def worst_errors(model, duct, load_cases):
    bare = ReducedDuct(duct.mesh, duct.basis, Residual.none(duct.basis.n_nodes), duct.damping_ratio)
    with_residual, without = [], []
    for forces in load_cases:
        full = model.solve_static(forces).displacement_m
        scale = np.abs(full).max()
        with_residual.append(np.abs(static_answer(duct, forces) - full).max() / scale)
        without.append(np.abs(static_answer(bare, forces) - full).max() / scale)
    return max(with_residual), max(without)


def every_free_node(model):
    held = set((model.held_dofs // 6).tolist())
    return [node for node in range(model.mesh.n_vertices) if node not in held]


def test_point_load_on_any_node_equals_the_full_model(model, duct):
    normals = vertex_normals(model.mesh)
    cases = []
    for node in every_free_node(model):
        forces = np.zeros((model.mesh.n_vertices, 3))
        forces[node] = normals[node] * 1e-3
        cases.append(forces)
    error, bare_error = worst_errors(model, duct, cases)
    print(f"point load, any node, r = 60: {error:.1e} with residual, {bare_error:.1%} without")
    assert error < 1e-3
    assert bare_error > 0.05


def test_pinch_on_any_node_equals_the_full_model(model, duct):
    normals = vertex_normals(model.mesh)
    cases = []
    for node in every_free_node(model):
        forces = np.zeros((model.mesh.n_vertices, 3))
        other = opposite_node(model.mesh, node)
        forces[node], forces[other] = -normals[node] * 1e-3, -normals[other] * 1e-3
        cases.append(forces)
    error, bare_error = worst_errors(model, duct, cases)
    print(f"pinch, any node, r = 60: {error:.1e} with residual, {bare_error:.1%} without")
    assert error < 1e-3
    assert bare_error > 0.05


def test_residual_does_not_act_on_the_kept_modes(model, basis):
    # Phi^T M R = 0: what R returns is orthogonal, by mass, to every mode that is kept.
    nodes = np.array([333], np.int32)
    response = residual_response(model, basis, nodes, np.zeros(1, np.int32))[:, 0]
    projection = np.einsum("nir,n,nij->rj", basis.Phi, model.mass_kg, response)
    scale = np.sqrt(np.sum(model.mass_kg[:, None, None] * response**2))
    assert np.abs(projection).max() < 1e-9 * scale


def test_residual_is_symmetric_and_positive_semidefinite(duct):
    nodes = np.arange(40, 620, 13, dtype=np.int32)
    R = between_nodes(duct.residual, nodes)
    assert np.array_equal(R, R.T)
    eigenvalues = np.linalg.eigvalsh(R)
    assert eigenvalues[0] > -1e-6 * eigenvalues[-1]


def full_blocks(duct):
    n = duct.basis.n_nodes
    return np.asarray(duct.residual.blocks, np.float64).reshape(n, n, 3, 3)


def random_points(duct, count):
    rng = np.random.default_rng(3)
    triangles = rng.choice(duct.mesh.triangles, count, replace=False).astype(np.int32)
    return triangles, rng.dirichlet(np.ones(3), count)


def dense_interpolation(duct, nodes, weights):
    G = np.zeros((len(nodes), 3, duct.basis.n_nodes, 3))
    for point, (corners, shares) in enumerate(zip(nodes, weights, strict=True)):
        for corner, share in zip(corners, shares, strict=True):
            G[point, :, corner] += share * np.eye(3)
    return G.reshape(3 * len(nodes), -1)


def test_kernels_equal_dense_algebra(duct):
    nodes, weights = random_points(duct, 7)
    G, n = dense_interpolation(duct, nodes, weights), duct.basis.n_nodes
    R = full_blocks(duct).transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)
    Phi = duct.basis.Phi.reshape(3 * n, -1)
    at_points, rows = np.empty((21, 21)), np.empty((21, duct.basis.n_modes))
    duct.residual.gather_points(nodes, weights, at_points, np.arange(7, dtype=np.int32))
    assert at_points == pytest.approx(G @ R @ G.T, rel=1e-12, abs=1e-12)
    q, dq = np.random.default_rng(4).standard_normal((2, duct.basis.n_modes))
    moved, change = np.empty((2, 7, 3))
    gather_modes((nodes, weights), duct.basis.Phi, (q, dq), (rows, moved, change))
    assert rows == pytest.approx(G @ Phi, abs=1e-12)
    assert moved.ravel() == pytest.approx(G @ Phi @ q, rel=1e-12, abs=1e-12)
    assert change.ravel() == pytest.approx(G @ Phi @ dq, rel=1e-12, abs=1e-12)


def test_apply_superposes_the_loads(duct):
    load_nodes, nodes = np.array([100, 371], np.int32), np.array([100, 5, 619], np.int32)
    forces = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]])
    out = np.ones((3, 3))
    duct.residual.apply(load_nodes, forces, nodes, out)
    expected = 1.0 + np.einsum("abij,bj->ai", full_blocks(duct)[nodes][:, load_nodes], forces)
    assert out == pytest.approx(expected, rel=1e-12)


@pytest.fixture(scope="module")
def exact_patches(model, basis):
    return build_patches(model, basis, 6e-3)


def test_patches_with_exact_columns_hold_the_full_blocks(duct, exact_patches):
    full = full_blocks(duct)
    rows = np.repeat(np.arange(duct.basis.n_nodes), np.diff(exact_patches.store.starts))
    assert exact_patches.blocks == pytest.approx(
        full[rows, exact_patches.store.neighbours], abs=1e-6 * np.abs(full).max()
    )


def test_patch_kernels_equal_the_full_ones_within_the_radius_and_drop_the_rest(duct, exact_patches):
    patches = exact_patches
    near = np.flatnonzero(np.linalg.norm(duct.mesh.vertices_m - duct.mesh.vertices_m[310], axis=1) < 2.9e-3)
    far = np.array([310, 610], np.int32)
    for nodes in (near.astype(np.int32), far):
        ours, full = between_nodes(patches, nodes), between_nodes(duct.residual, nodes)
        if nodes is far:
            full[:3, 3:] = full[3:, :3] = 0.0
        assert ours == pytest.approx(full, abs=2e-6 * np.abs(full).max())


def test_wider_patches_leave_less_error(model, duct):
    # Measured away from the clamp, where every compliance is small and the cut shows most.
    free = np.flatnonzero(duct.mesh.vertices_m[:, 0] > 10e-3)
    full = full_blocks(duct)
    norms = np.linalg.norm(full, axis=(2, 3))
    dropped = []
    for radius in (2.5e-3, 5e-3, 10e-3):
        starts, neighbours = patch_pattern(duct.mesh.vertices_m, radius)
        outside = norms.copy()
        outside[np.repeat(np.arange(duct.basis.n_nodes), np.diff(starts)), neighbours] = 0.0
        dropped.append(outside[free].max() / norms[free, free].max())
    print(f"largest block dropped over largest own block, radius 2.5, 5, 10 mm: {dropped}")
    assert all(wide < 0.6 * narrow for narrow, wide in pairwise(dropped))


def test_probing_costs_few_solves_and_little_error(model, duct, exact_patches):
    radius = 6e-3
    colours = colour_apart(duct.mesh.vertices_m, 2.0 * radius)
    pairs = colours[:, None] == colours[None]
    distance = np.linalg.norm(duct.mesh.vertices_m[:, None] - duct.mesh.vertices_m[None], axis=2)
    assert distance[pairs & ~np.eye(len(colours), dtype=bool)].min() > 2.0 * radius
    assert colours.max() + 1 < 0.7 * len(colours)
    probed = build_patches(model, duct.basis, radius, apart_m=2.0 * radius)
    exact = exact_patches
    error = np.linalg.norm(probed.blocks - exact.blocks, axis=(1, 2))
    own = np.flatnonzero(np.repeat(np.arange(620), np.diff(exact.store.starts)) == exact.store.neighbours)
    assert error.max() < 0.1 * np.linalg.norm(exact.blocks[own], axis=(1, 2)).max()


def test_probing_leaves_the_loaded_node_and_its_neighbours_exact(model, duct):
    """Two radii apart, the worst case of probing: what a point load does to its node and those beside it is exact."""
    probed, n = build_patches(model, duct.basis, 5e-3, apart_m=10e-3), duct.basis.n_nodes
    rows = np.repeat(np.arange(n), np.diff(probed.store.starts))
    error = np.linalg.norm(probed.blocks - full_blocks(duct)[rows, probed.store.neighbours], axis=(1, 2))
    beside = vertex_adjacency(duct.mesh)[rows, probed.store.neighbours].astype(bool) | (rows == probed.store.neighbours)
    scale = np.linalg.norm(full_blocks(duct)[np.arange(n), np.arange(n)], axis=(1, 2)).max()
    print(
        f"probed patches: worst {error[beside].max() / scale:.1e} near, {error.max() / scale:.1e} anywhere in a patch"
    )
    assert beside.sum() > 6 * n
    assert error[beside].max() < 1e-6 * scale
    assert error.max() > 1e-3 * scale, "else there is nothing to replace"


@pytest.mark.parametrize("apart_m", [math.inf, 10e-3])
def test_what_patches_leave_out_is_measured_and_said(model, duct, apart_m):
    """Against the full blocks between all nodes, of which the measurement knows eight columns."""
    patches, n = build_patches(model, duct.basis, 5e-3, apart_m), duct.basis.n_nodes
    rows = np.repeat(np.arange(n), np.diff(patches.store.starts))
    off = np.zeros((n, n, 3, 3))
    off[rows, patches.store.neighbours] = patches.blocks
    off -= full_blocks(duct)
    flexible = duct.basis.Phi / duct.basis.omega_rad_s
    own = np.linalg.norm(full_blocks(duct)[range(n), range(n)] + flexible @ flexible.transpose(0, 2, 1), 2, axis=(1, 2))
    share = np.linalg.norm(off, 2, axis=(2, 3)) / np.maximum(own, 1e-300)[:, None]
    is_kept = np.zeros((n, n), bool)
    is_kept[rows, patches.store.neighbours] = True
    free = own > 1e-6 * own.max()
    kept, dropped = share[free][is_kept[free]].max(), share[free][~is_kept[free]].max()
    measured = measure_patches(model, duct.basis, patches)
    assert kept / 5.0 <= measured.kept <= kept * 1.01 + 1e-6
    assert dropped / 5.0 <= measured.dropped <= dropped * 1.01
    assert f"{100 * measured.dropped:.2g} % far from it" in measured.sentence()
    assert PatchError(0.0, 1e-4).sentence() is None


def test_selected_inverse_is_the_inverse_where_the_factor_has_entries(model):
    inverse = SelectedInverse.of(model.K_free, model.factor)
    chosen = np.random.default_rng(4).choice(len(model.free_dofs), 12, replace=False)
    loads = np.zeros((len(model.free_dofs), 12))
    loads[chosen, np.arange(12)] = 1.0
    columns = model.factor.solve(loads)
    unplaced = np.argsort(inverse.place)
    for k, column in enumerate(columns.T):
        place = inverse.place[chosen[k]]
        here = slice(inverse.starts[place], inverse.starts[place + 1])
        expected = column[unplaced[inverse.rows[here]]]
        assert inverse.values[here] == pytest.approx(expected, abs=1e-12 * np.abs(column).max())


def test_radius_for_a_budget_fits_it_and_is_the_largest(model):
    vertices = model.mesh.vertices_m
    radius = largest_radius_m(vertices, 4_000_000)
    pairs = [patch_pattern(vertices, r)[1].size for r in (radius, 1.05 * radius)]
    assert pairs[0] * 40 <= 4_000_000
    assert pairs[1] * 40 > 3_800_000


def test_a_budget_too_small_for_anything_is_refused(model):
    with pytest.raises(ValueError, match="620 nodes does not fit 1000 bytes"):
        largest_radius_m(model.mesh.vertices_m, 1000)


def test_blocks_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"shape \(4, 5, 3, 3\)"):
        Residual.full(np.zeros((4, 5, 3, 3)))
