"""What every element of the tables must do; an element is found here by its row, nothing else is to be edited.

`trocar` and the reduction rest on these properties. An element that is for comparison only (``is_reference_only``)
must have the structure of a stiffness, and is shown not to pass what the others must.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from tests.mechanics.fem.patches import (
    CURVATURE,
    SECTION,
    STRAIN,
    biharmonic_deflection,
    constant_state_energy,
    displacement_error,
    distorted_square,
    in_plane_bending,
    random_rotation,
    solve_patch,
)
from trocar.services.mechanics.fem import ElementChoice, ShellModel, Support
from trocar.services.mechanics.fem.assembly import assemble_stiffness
from trocar.services.mechanics.fem.boundary_conditions import rigid_body_modes
from trocar.services.mechanics.fem.elements import BENDING_ELEMENTS, MEMBRANE_ELEMENTS
from trocar.services.mechanics.fem.elements.element import Element
from trocar.services.mechanics.fem.triangle import signed_areas
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.studies.published.shells import mapped_patch


@dataclass(frozen=True)
class Row:
    """A row of one of the tables, with a partner that carries the other part of the stiffness."""

    kind: str
    name: str
    element: Element

    @property
    def choice(self) -> ElementChoice:
        return ElementChoice(self.name, "dkt") if self.kind == "membrane" else ElementChoice("cst", self.name)

    @property
    def states(self):
        return STRAIN if self.kind == "membrane" else CURVATURE


EVERY = [
    Row(kind, name, element)
    for kind, table in (("membrane", MEMBRANE_ELEMENTS), ("bending", BENDING_ELEMENTS))
    for name, element in table.items()
]
every = pytest.mark.parametrize("row", EVERY, ids=lambda row: row.name)
consistent = pytest.mark.parametrize(
    "row", [row for row in EVERY if not row.element.is_reference_only], ids=lambda row: row.name
)
reference_only = pytest.mark.parametrize(
    "row", [row for row in EVERY if row.element.is_reference_only], ids=lambda row: row.name
)


def some_triangles(n=40):
    """Triangles of all shapes with no angle below 15 degrees, counter-clockwise."""
    rng, found = np.random.default_rng(4), []
    while len(found) < n:
        xy = rng.uniform(-1.0, 1.0, (3, 2))
        sides = np.roll(xy, -1, axis=0) - xy
        length = np.linalg.norm(sides, axis=1)
        area = sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0]
        if area > np.sin(np.radians(15.0)) * np.max(length * np.roll(length, 1)):
            found.append(xy)
    return np.array(found)


def some_rigidities(n=40):
    """Orthotropic plane-stress matrices with their axes turned anyhow: symmetric, positive definite."""
    factor = np.random.default_rng(5).uniform(-0.3, 0.3, (n, 3, 3)) + np.eye(3)
    return factor @ factor.transpose(0, 2, 1)


def isotropic(n=40, nu=0.3):
    return np.broadcast_to([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]], (n, 3, 3)).copy()


def unscaled(row, xy, rigidity):
    """(m, 9, 9) of triangles 0.3 thick: what a thick wall gives way by is part of it."""
    return row.element.stiffness(xy, rigidity, np.full(len(xy), 0.3))


def stiffness(row, xy, rigidity):
    """(m, 9, 9), scaled so that the largest entry of each matrix is one."""
    K = unscaled(row, xy, rigidity)
    assert K.shape == (len(xy), 9, 9)
    return K / np.abs(K).max(axis=(1, 2), keepdims=True)


def rigid_motions(row, xy):
    """(m, 9, 3) nodal values of two translations and a rotation, or of a deflection and two tilts."""
    x, y = xy[..., 0], xy[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    if row.kind == "membrane":
        motions = [(one, zero, zero), (zero, one, zero), (-y, x, one)]
    else:
        motions = [(one, zero, zero), (y, one, zero), (x, zero, -one)]
    return np.stack([np.stack(nodal, axis=-1).reshape(-1, 9) for nodal in motions], axis=-1)


@every
def test_stiffness_is_symmetric(row):
    """Of the element itself: what is assembled is made exactly symmetric, which would hide it."""
    K = stiffness(row, some_triangles(), some_rigidities())
    assert np.abs(K - K.transpose(0, 2, 1)).max() < 1e-12


@every
def test_rigid_motions_cost_nothing_and_nothing_else_does(row):
    """Rank six: neither a mechanism nor a resistance to rigid motion, and no negative energy."""
    xy = some_triangles()
    K = stiffness(row, xy, some_rigidities())
    assert np.abs(K @ rigid_motions(row, xy)).max() < 1e-12
    eigenvalues = np.linalg.eigvalsh(0.5 * (K + K.transpose(0, 2, 1)))
    assert np.abs(eigenvalues[:, :3]).max() < 1e-12
    assert eigenvalues[:, 3].min() > 1e-7


@every
def test_stiffness_is_proportional_to_the_rigidity(row):
    xy, rigidity = some_triangles(), some_rigidities()
    once, thrice = unscaled(row, xy, rigidity), unscaled(row, xy, 3.0 * rigidity)
    assert np.abs(thrice - 3.0 * once).max() < 1e-12 * np.abs(once).max()


@every
def test_a_triangle_does_not_see_the_others_of_its_batch(row):
    xy, rigidity = some_triangles(), some_rigidities()
    together = unscaled(row, xy, rigidity)
    for k in range(len(xy)):
        alone = unscaled(row, xy[k : k + 1], rigidity[k : k + 1])[0]
        assert np.abs(alone - together[k]).max() < 1e-13 * np.abs(alone).max()


@consistent
def test_no_node_is_the_first(row):
    xy, rigidity, order = some_triangles(), some_rigidities(), np.array([1, 2, 0])
    K = stiffness(row, xy, rigidity)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    assert np.abs(stiffness(row, xy[:, order], rigidity) - K[:, dofs[:, None], dofs]).max() < 1e-12


@consistent
def test_an_isotropic_triangle_may_be_turned_in_its_plane(row):
    xy, rigidity, angle = some_triangles(), isotropic(), 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    per_node = np.eye(3)
    vector = slice(0, 2) if row.kind == "membrane" else slice(1, 3)
    per_node[vector, vector] = turn
    T = np.kron(np.eye(3), per_node)
    turned = unscaled(row, xy @ turn.T, rigidity)
    straight = unscaled(row, xy, rigidity)
    assert np.abs(T.T @ turned @ T - straight).max() < 1e-12 * np.abs(straight).max()


@every
def test_a_row_says_whether_drilling_is_stiff(row):
    """Against the shear of the triangle: a penalty that only removes the singularity is a thousandth of it."""
    if row.kind == "bending":
        assert not row.element.has_stiff_drilling
        return
    xy, rigidity = some_triangles(), isotropic()
    drilling = unscaled(row, xy, rigidity)[:, [2, 5, 8], [2, 5, 8]].mean(axis=1)
    of_shear = drilling / (0.3 * rigidity[:, 2, 2] * signed_areas(xy))
    assert (of_shear > 0.01).all() if row.element.has_stiff_drilling else (of_shear < 0.01).all()


def patch_test_error(row, kind):
    """The worse of the relative errors of displacement inside and of energy."""
    error, energy = solve_patch(kind, row.choice)
    return max(error, abs(energy / constant_state_energy(kind) - 1.0))


@consistent
@pytest.mark.parametrize("state", [0, 1, 2])
def test_patch_test_on_a_distorted_turned_mesh(row, state):
    assert patch_test_error(row, list(row.states)[state]) < 1e-9


@reference_only
@pytest.mark.parametrize("state", [0, 1, 2])
def test_an_element_for_comparison_only_fails_the_patch_test(row, state):
    """Documented, not tolerated: one that passes has no reason to be marked so."""
    assert patch_test_error(row, list(row.states)[state]) > 1e-3


@every
def test_free_mesh_has_exactly_six_zero_energy_modes(row):
    s = np.linspace(0, 1, 5)
    curved = mapped_patch(4, 4, lambda s, t: (s, t, 0.3 * s**2 - 0.2 * s * t))
    K = assemble_stiffness(curved.mesh, SECTION, row.choice).toarray()
    assert np.array_equal(K, K.T)
    eigenvalues = np.linalg.eigvalsh(K)
    assert np.abs(eigenvalues[:6]).max() < 1e-11 * eigenvalues[-1]
    assert eigenvalues[6] > 1e-8 * eigenvalues[-1]
    rigid = rigid_body_modes(curved.mesh.vertices_m, np.zeros(3)).reshape(-1, 6)
    assert np.abs(K @ rigid).max() < 1e-11 * np.abs(K).max() * len(s)


@every
def test_flat_patch_has_exactly_six_zero_energy_modes(row):
    """Coplanar triangles are where a membrane without drilling stiffness goes singular."""
    flat, _ = distorted_square(4)
    eigenvalues = np.linalg.eigvalsh(assemble_stiffness(flat, SECTION, row.choice).toarray())
    assert np.abs(eigenvalues[:6]).max() < 1e-11 * eigenvalues[-1]
    assert eigenvalues[6] > 1e-8 * eigenvalues[-1]


def pulled_strip(mesh, elements, force_n, places):
    """Displacement of a bent strip, clamped along one edge and loaded at one vertex."""
    model = ShellModel(mesh, SECTION, [Support(places["held"])], elements)
    load = np.zeros((mesh.n_vertices, 3))
    load[places["loaded"]] = force_n
    return model.solve_static(load).displacement_m


@consistent
def test_result_does_not_depend_on_numbering_or_axes(row):
    patch = mapped_patch(5, 4, lambda s, t: (s, 0.6 * t, 0.3 * s**2 - 0.2 * s * t**2))
    places = {"held": patch.grid[0], "loaded": patch.grid[-1, 1]}
    force_n = np.array([0.1, -0.2, 0.5])
    u = pulled_strip(patch.mesh, row.choice, force_n, places)
    rng = np.random.default_rng(8)
    new_index = rng.permutation(patch.mesh.n_vertices)
    R = random_rotation(5)
    xyz = np.empty_like(patch.mesh.vertices_m)
    xyz[new_index] = patch.mesh.vertices_m @ R.T
    triangles = new_index[patch.mesh.triangles[rng.permutation(patch.mesh.n_triangles)]]
    first = rng.integers(0, 3, len(triangles))
    triangles = triangles[np.arange(len(triangles))[:, None], (first[:, None] + np.arange(3)) % 3]
    renamed = {name: new_index[where] for name, where in places.items()}
    turned = pulled_strip(TriangleMesh(xyz, triangles), row.choice, R @ force_n, renamed)
    assert np.abs(turned[new_index] - u @ R.T).max() < 1e-9 * np.abs(u).max()


@consistent
def test_displacement_error_falls_with_the_square_of_the_mesh_size(row):
    exact_field = in_plane_bending if row.kind == "membrane" else biharmonic_deflection
    n = np.array([4, 8, 16, 32])
    error = [displacement_error(k, row.choice, exact_field) for k in n]
    rate = -np.polyfit(np.log(n), np.log(error), 1)[0]
    assert rate > 1.8, error
