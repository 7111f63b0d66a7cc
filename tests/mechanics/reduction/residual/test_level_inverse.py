"""K^-1 level by level agrees with solves, wherever the wall is held and however it was cut or meshed."""

import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp
from trocar.services.mechanics.reduction.residual.level_inverse import compliance_rows, node_levels
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_adjacency
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

SECTION = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
TUBE = parametric_duct(DuctGeometry(4e-3, 20e-3, 12, 11))
SLIT = parametric_duct(DuctGeometry(4e-3, 20e-3, 12, 11, curvature_1_m=20.0, slit_length_m=8e-3, slit_width_m=2e-3))
SHUFFLED_ORDER = np.random.default_rng(4).permutation(TUBE.n_vertices)
SHUFFLED = TriangleMesh(
    TUBE.vertices_m[np.argsort(SHUFFLED_ORDER)],
    SHUFFLED_ORDER[TUBE.triangles].astype(np.int32),
    {"clamped": SHUFFLED_ORDER[TUBE.vertex_sets["clamped"]].astype(np.int32)},
)
SOME_FREE = Support(TUBE.vertex_sets["mouth"], ("ux", "uz", "ry"))
CASES = {
    "clamped": (TUBE, [clamp(TUBE)]),
    "slit": (SLIT, [clamp(SLIT)]),
    "numbered by chance": (SHUFFLED, [clamp(SHUFFLED)]),
    "held at both ends, at one in part": (TUBE, [clamp(TUBE), SOME_FREE]),
    "held by three nodes": (TUBE, [Support(np.array([40, 44, 48], np.int32))]),
}


@pytest.fixture(params=CASES.values(), ids=CASES.keys())
def model(request) -> ShellModel:
    mesh, supports = request.param
    return ShellModel(mesh, SECTION, supports, ElementChoice("andes", "dkt"))


def test_every_pair_of_nodes_has_the_compliance_of_a_solve(model):
    n = model.mesh.n_vertices
    G = np.zeros((n, 3, n, 3))
    for nodes, rows in compliance_rows(model):
        level = nodes[: len(rows)]
        G[level[:, None], :, nodes] = rows.transpose(0, 2, 1, 3)
        G[nodes[:, None], :, level] = rows.transpose(2, 0, 3, 1)
    solved = np.zeros((n, 6, n, 6)).reshape(6 * n, 6 * n)
    solved[np.ix_(model.free_dofs, model.free_dofs)] = model.solve_free(np.eye(len(model.free_dofs)))
    expected = solved.reshape(n, 6, n, 6)[:, :3, :, :3]
    own = np.sqrt(np.einsum("nana->n", expected))
    scale = np.maximum.outer(own, own)[:, None, :, None] ** 2 + 1e-12 * own.max() ** 2
    assert np.abs(G - expected).max() < 1e-6 * np.abs(expected).max()
    assert np.abs((G - expected) / scale).max() < 1e-8


def test_levels_hold_every_node_once_and_neighbours_skip_none(model):
    levels = node_levels(model.mesh, model.held_dofs)
    assert np.array_equal(np.sort(np.concatenate(levels)), np.arange(model.mesh.n_vertices))
    number = np.empty(model.mesh.n_vertices, int)
    for index, nodes in enumerate(levels):
        number[nodes] = index
    one, other = vertex_adjacency(model.mesh).nonzero()
    assert np.abs(number[one] - number[other]).max() == 1
