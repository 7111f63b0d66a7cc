"""Single elements: what is published of each, and materials that vary and have a direction."""

import numpy as np
import pytest

from tests.mechanics.fem.patches import NU, SECTION, distorted_square
from trocar.services.mechanics.fem import ElementChoice, Orthotropy, ShellModel, ShellSection, Support
from trocar.services.mechanics.fem.assembly import assemble_stiffness
from trocar.services.mechanics.fem.elements import tocher
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.studies.published.shells import mapped_patch, plate_deflection

GOOD = [ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")]
EVERY = [*GOOD, ElementChoice("cst", "tocher"), ElementChoice("andes", "tocher")]


def test_tocher_triangle_depends_on_which_node_is_first():
    xy = np.array([[[0.0, 0.0], [0.0, 1.0], [-0.8, 0.3]]])
    rigidity = np.eye(3)[None]
    K = tocher.stiffness(xy, rigidity, np.ones(1))[0]
    order = np.array([1, 2, 0])
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    turned = tocher.stiffness(xy[:, order], rigidity, np.ones(1))[0]
    assert np.abs(turned - K[np.ix_(dofs, dofs)]).max() > 1e-3 * np.abs(K).max()


def test_tocher_triangle_renames_nodes_where_it_is_singular():
    """A right isosceles triangle with its legs on the local axes has a singular coefficient matrix."""
    xy = np.array([[[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]])
    assert tocher.singularity(xy)[0, 0] == pytest.approx(0.0, abs=1e-15)
    K = tocher.stiffness(xy, np.eye(3)[None], np.ones(1))[0]
    eigenvalues = np.linalg.eigvalsh(K)
    assert np.abs(eigenvalues[:3]).max() < 1e-12 * eigenvalues[-1]
    assert eigenvalues[3] > 1e-6 * eigenvalues[-1]


def test_tocher_triangle_is_refused_where_every_node_is_singular(monkeypatch):
    monkeypatch.setattr(tocher, "SINGULAR_RATIO", 0.9)
    with pytest.raises(ValueError, match="singular on triangle 0"):
        tocher.stiffness(np.array([[[0.0, 0.0], [0.0, 1.0], [-0.866, 0.5]]]), np.eye(3)[None], np.ones(1))


def test_optimal_triangle_bends_a_slender_strip_exactly():
    """Felippa 2003: pure in-plane bending of a rectangular unit is exact at any aspect ratio (nu = 0); cst locks."""
    ratio = {}
    for name in ("cst", "andes"):
        patch = mapped_patch(10, 1, lambda s, t: (100.0 * s, t - 0.5, np.zeros_like(s)))
        section = ShellSection(1.0, 1.0, 0.0, 1.0)
        grid = patch.grid
        supports = [
            Support(grid.ravel(), ("uz", "rx", "ry")),
            Support(grid[0], ("ux", "rz")),
            Support(grid[0, :1], ("uy",)),
        ]
        model = ShellModel(patch.mesh, section, supports, ElementChoice(name, "dkt"))
        load = np.zeros((patch.mesh.n_vertices, 6))
        load[grid[-1], 0] = [1.0, -1.0]
        curvature = 1.0 / (1.0 / 12.0)
        u = model.solve_static(load)
        ratio[name] = u.displacement_m[grid[-1], 1].mean() / (0.5 * curvature * 100.0**2)
    assert ratio["andes"] == pytest.approx(1.0, abs=0.02)
    assert ratio["cst"] < 0.1


def test_tocher_triangle_converges_to_a_wrong_plate():
    """Simply supported, uniform load: settled between meshes, and a quarter too soft for ever."""
    exact = 0.00406235
    coarse, fine = (plate_deflection(n, False, False, ElementChoice("cst", "tocher")) for n in (16, 32))
    assert fine == pytest.approx(coarse, rel=0.01)
    assert abs(fine / exact - 1) > 0.2


@pytest.mark.parametrize("elements", GOOD, ids=str)
def test_orthotropic_sheet_stretches_by_its_own_moduli(elements):
    """Uniaxial tension along and across a skewed material axis, against Hooke's law."""
    ratio, shear_ratio, angle = 0.2, 0.15, np.radians(30.0)
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])
    section = ShellSection(0.02, 2e5, NU, 1000.0, Orthotropy(axis, ratio, shear_ratio))
    mesh, _ = distorted_square(4)
    E1 = 2e5
    S = np.array([[1, -NU, 0], [-NU, 1 / ratio, 0], [0, 0, 1 / shear_ratio]]) / E1
    c, s = axis[:2]
    T = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
    xx, yy, xy = T.T @ np.linalg.inv(S) @ T @ np.array([1.0, 0.0, 0.0])
    exact = np.zeros((mesh.n_vertices, 6))
    exact[:, 0] = mesh.vertices_m[:, 0]
    model = ShellModel(mesh, section, [Support(np.arange(mesh.n_vertices))], elements)
    reaction = model.solve_static(np.zeros((mesh.n_vertices, 3)), imposed=exact).reaction
    right = mesh.vertices_m[:, 0] > 1 - 1e-9
    top = mesh.vertices_m[:, 1] > 1 - 1e-9
    inner_right = reaction[right & ~top & (mesh.vertices_m[:, 1] > 1e-9)]
    assert inner_right[:, 0].mean() == pytest.approx(0.02 * xx / 4, rel=1e-9)
    assert inner_right[:, 1].mean() == pytest.approx(0.02 * xy / 4, rel=1e-9)
    inner_top = reaction[top & ~right & (mesh.vertices_m[:, 0] > 1e-9)]
    assert inner_top[:, 1].mean() == pytest.approx(0.02 * yy / 4, rel=1e-9)


def test_isotropic_material_is_the_orthotropic_one_with_equal_moduli():
    mesh, _ = distorted_square(3)
    G_over_E = 1 / (2 * (1 + NU))
    same = ShellSection(0.02, 2e5, NU, 1000.0, Orthotropy(np.array([0.3, 0.9, 0.1]), 1.0, G_over_E))
    for elements in EVERY:
        K = assemble_stiffness(mesh, SECTION, elements).toarray()
        assert np.abs(assemble_stiffness(mesh, same, elements).toarray() - K).max() < 1e-12 * np.abs(K).max()


def test_thickness_and_modulus_may_vary_from_triangle_to_triangle():
    mesh, _ = distorted_square(3)
    half = np.arange(mesh.n_triangles) % 2 == 0
    mixed = ShellSection(np.where(half, 0.02, 0.04), np.where(half, 2e5, 1e5), NU, 1000.0)
    parts = []
    for chosen, h, E in ((half, 0.02, 2e5), (~half, 0.04, 1e5)):
        part = TriangleMesh(mesh.vertices_m, mesh.triangles[chosen])
        parts.append(assemble_stiffness(part, ShellSection(h, E, NU, 1000.0), GOOD[0]).toarray())
    whole = assemble_stiffness(mesh, mixed, GOOD[0]).toarray()
    assert np.abs(whole - sum(parts)).max() < 1e-13 * np.abs(whole).max()
