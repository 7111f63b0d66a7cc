"""Elements alone and on distorted patches: what theory says they must reproduce exactly, and what they must not."""

import numpy as np
import pytest

from services.mechanics.fem import ElementChoice, Orthotropy, ShellModel, ShellSection, Support, paper
from services.mechanics.fem.assembly import assemble_stiffness
from services.mechanics.fem.elements import MEMBRANE_ELEMENTS
from services.mechanics.fem.supports import rigid_body_modes
from services.mechanics.surface.mesh import TriangleMesh
from services.studies.shell_problems import mapped_patch, plate_deflection

NU = 0.3
SECTION = ShellSection(0.02, 2e5, NU, 1000.0)
GOOD = [ElementChoice("cst", "dkt"), ElementChoice("opt", "dkt")]
EVERY = [*GOOD, ElementChoice("cst", "paper"), ElementChoice("opt", "paper")]


def random_rotation(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def distorted_square(n, seed=3, amount=0.3):
    """Unit square in the xy plane with interior nodes moved by up to `amount` of a cell."""
    grid = mapped_patch(n, n, lambda s, t: (s, t, np.zeros_like(s)))
    xyz = grid.mesh.vertices_m.copy()
    inner = grid.grid[1:-1, 1:-1].ravel()
    xyz[inner, :2] += np.random.default_rng(seed).uniform(-amount, amount, (len(inner), 2)) / n
    return TriangleMesh(xyz, grid.mesh.triangles), inner


def field_on(xyz, kind):
    """(n, 6) displacement and rotation of the named state at points of the xy plane."""
    x, y = xyz[:, 0], xyz[:, 1]
    u = np.zeros((len(x), 6))
    if kind == "stretch x":
        u[:, 0] = 1e-3 * x
    elif kind == "stretch y":
        u[:, 1] = 1e-3 * y
    elif kind == "shear":
        u[:, 0], u[:, 5] = 1e-3 * y, -0.5e-3
    else:
        xx, yy, twist = {"bend x": (1, 0, 0), "bend y": (0, 1, 0), "twist": (0, 0, 1)}[kind]
        u[:, 2] = 1e-2 * (0.5 * xx * x**2 + 0.5 * yy * y**2 + twist * x * y)
        u[:, 3] = 1e-2 * (yy * y + twist * x)
        u[:, 4] = -1e-2 * (xx * x + twist * y)
    return u


STRAIN = {"stretch x": (1e-3, 0, 0), "stretch y": (0, 1e-3, 0), "shear": (0, 0, 1e-3)}
CURVATURE = {"bend x": (1e-2, 0, 0), "bend y": (0, 1e-2, 0), "twist": (0, 0, 2e-2)}


def exact_energy(kind):
    """Strain energy of the unit square in a constant state."""
    E, h = SECTION.youngs_modulus_pa, SECTION.thickness_m
    D = E / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
    state = np.array(STRAIN.get(kind) or CURVATURE[kind])
    return 0.5 * (h if kind in STRAIN else h**3 / 12) * state @ D @ state


def solve_patch(kind, elements, seed=1):
    """Impose the state on the border of a distorted, arbitrarily turned patch; return interior error and energy."""
    flat, inner = distorted_square(4)
    R = random_rotation(seed)
    mesh = TriangleMesh(flat.vertices_m @ R.T + np.array([3.0, -2.0, 1.0]), flat.triangles)
    exact = field_on(flat.vertices_m, kind).reshape(-1, 2, 3) @ R.T
    exact = exact.reshape(-1, 6)
    border = np.setdiff1d(np.arange(mesh.n_vertices), inner)
    model = ShellModel(mesh, SECTION, [Support(border)], elements)
    found = model.solve_static(np.zeros((mesh.n_vertices, 3)), imposed=exact)
    u = np.hstack([found.displacement_m, found.rotation_rad])
    energy = 0.5 * u.ravel() @ (model.K_full @ u.ravel())
    return np.abs(u - exact).max() / np.abs(exact).max(), energy


@pytest.mark.parametrize("elements", GOOD, ids=str)
@pytest.mark.parametrize("kind", [*STRAIN, *CURVATURE])
def test_patch_test_on_a_distorted_turned_mesh(kind, elements):
    error, energy = solve_patch(kind, elements)
    assert error < 1e-9
    assert energy == pytest.approx(exact_energy(kind), rel=1e-9)


@pytest.mark.parametrize("kind", CURVATURE)
def test_the_papers_triangle_fails_the_bending_patch_test(kind):
    """Documented, not tolerated: it is why `dkt` is the default."""
    error, _ = solve_patch(kind, ElementChoice("cst", "paper"))
    assert error > 1e-3


@pytest.mark.parametrize("elements", EVERY, ids=str)
def test_free_mesh_has_exactly_six_zero_energy_modes(elements):
    s = np.linspace(0, 1, 5)
    curved = mapped_patch(4, 4, lambda s, t: (s, t, 0.3 * s**2 - 0.2 * s * t))
    K = assemble_stiffness(curved.mesh, SECTION, elements).toarray()
    assert np.array_equal(K, K.T)
    eigenvalues = np.linalg.eigvalsh(K)
    assert np.abs(eigenvalues[:6]).max() < 1e-11 * eigenvalues[-1]
    assert eigenvalues[6] > 1e-8 * eigenvalues[-1]
    rigid = rigid_body_modes(curved.mesh.vertices_m, np.zeros(3)).reshape(-1, 6)
    assert np.abs(K @ rigid).max() < 1e-11 * np.abs(K).max() * len(s)


@pytest.mark.parametrize("elements", EVERY, ids=str)
def test_flat_patch_has_exactly_six_zero_energy_modes(elements):
    """Coplanar triangles are where a membrane without drilling stiffness goes singular."""
    flat, _ = distorted_square(4)
    eigenvalues = np.linalg.eigvalsh(assemble_stiffness(flat, SECTION, elements).toarray())
    assert np.abs(eigenvalues[:6]).max() < 1e-11 * eigenvalues[-1]
    assert eigenvalues[6] > 1e-8 * eigenvalues[-1]


def pinched_strip(mesh, elements, push, order):
    """Displacement of one loaded free vertex of a bent strip, clamped along one edge."""
    model = ShellModel(mesh, SECTION, [Support(order["held"])], elements)
    load = np.zeros((mesh.n_vertices, 3))
    load[order["loaded"]] = push
    return model.solve_static(load).displacement_m


@pytest.mark.parametrize("elements", GOOD, ids=str)
def test_result_does_not_depend_on_numbering_or_axes(elements):
    patch = mapped_patch(5, 4, lambda s, t: (s, 0.6 * t, 0.3 * s**2 - 0.2 * s * t**2))
    places = {"held": patch.grid[0], "loaded": patch.grid[-1, 1]}
    push = np.array([0.1, -0.2, 0.5])
    u = pinched_strip(patch.mesh, elements, push, places)
    rng = np.random.default_rng(8)
    new_index = rng.permutation(patch.mesh.n_vertices)
    R = random_rotation(5)
    xyz = np.empty_like(patch.mesh.vertices_m)
    xyz[new_index] = patch.mesh.vertices_m @ R.T
    triangles = new_index[patch.mesh.triangles[rng.permutation(patch.mesh.n_triangles)]]
    first = rng.integers(0, 3, len(triangles))
    triangles = triangles[np.arange(len(triangles))[:, None], (first[:, None] + np.arange(3)) % 3]
    renamed = {name: new_index[where] for name, where in places.items()}
    turned = pinched_strip(TriangleMesh(xyz, triangles), elements, R @ push, renamed)
    assert np.abs(turned[new_index] - u @ R.T).max() < 1e-9 * np.abs(u).max()


def test_the_papers_triangle_depends_on_which_node_is_first():
    xy = np.array([[[0.0, 0.0], [0.0, 1.0], [-0.8, 0.3]]])
    rigidity = np.eye(3)[None]
    K = paper.stiffness(xy, rigidity)[0]
    order = np.array([1, 2, 0])
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    turned = paper.stiffness(xy[:, order], rigidity)[0]
    assert np.abs(turned - K[np.ix_(dofs, dofs)]).max() > 1e-3 * np.abs(K).max()


def test_the_papers_triangle_renames_nodes_where_it_is_singular():
    """A right isosceles triangle with its legs on the local axes has a singular coefficient matrix."""
    xy = np.array([[[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]])
    assert paper.singularity(xy)[0, 0] == pytest.approx(0.0, abs=1e-15)
    K = paper.stiffness(xy, np.eye(3)[None])[0]
    eigenvalues = np.linalg.eigvalsh(K)
    assert np.abs(eigenvalues[:3]).max() < 1e-12 * eigenvalues[-1]
    assert eigenvalues[3] > 1e-6 * eigenvalues[-1]


def test_the_papers_triangle_is_refused_where_every_node_is_singular(monkeypatch):
    monkeypatch.setattr(paper, "SINGULAR_RATIO", 0.9)
    with pytest.raises(ValueError, match="singular on triangle 0"):
        paper.stiffness(np.array([[[0.0, 0.0], [0.0, 1.0], [-0.866, 0.5]]]), np.eye(3)[None])


def test_optimal_triangle_bends_a_slender_strip_exactly():
    """Felippa 2003: pure in-plane bending of a rectangular unit is exact at any aspect ratio (nu = 0); cst locks."""
    ratio = {}
    for name in MEMBRANE_ELEMENTS:
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
    assert ratio["opt"] == pytest.approx(1.0, abs=0.02)
    assert ratio["cst"] < 0.1


def regular_refinement_error(n, elements, field):
    mesh, inner = distorted_square(n, amount=0.2)
    exact = field(mesh.vertices_m)
    border = np.setdiff1d(np.arange(mesh.n_vertices), inner)
    model = ShellModel(mesh, SECTION, [Support(border)], elements)
    found = model.solve_static(np.zeros((mesh.n_vertices, 3)), imposed=exact).displacement_m
    return np.sqrt(np.mean((found - exact[:, :3])[inner] ** 2))


def in_plane_bending(xyz):
    """Exact plane-stress solution of a beam in pure bending: strains (y, -nu y, 0)."""
    x, y = xyz[:, 0], xyz[:, 1]
    u = np.zeros((len(x), 6))
    u[:, 0], u[:, 1], u[:, 5] = x * y, -0.5 * (x**2 + NU * y**2), -x
    return u


def biharmonic_deflection(xyz):
    """Exact unloaded plate: w = x⁴ - 6 x² y² + y⁴ + x³."""
    x, y = xyz[:, 0], xyz[:, 1]
    u = np.zeros((len(x), 6))
    u[:, 2] = x**4 - 6 * x**2 * y**2 + y**4 + x**3 - 3 * x * y**2
    u[:, 3] = -12 * x**2 * y + 4 * y**3 - 6 * x * y
    u[:, 4] = -(4 * x**3 - 12 * x * y**2 + 3 * x**2 - 3 * y**2)
    return u


@pytest.mark.parametrize(
    ("elements", "field"),
    [(GOOD[0], in_plane_bending), (GOOD[1], in_plane_bending), (GOOD[0], biharmonic_deflection)],
    ids=["cst", "opt", "dkt"],
)
def test_displacement_error_falls_with_the_square_of_the_mesh_size(elements, field):
    n = np.array([4, 8, 16, 32])
    error = [regular_refinement_error(k, elements, field) for k in n]
    rate = -np.polyfit(np.log(n), np.log(error), 1)[0]
    assert rate > 1.8, error


def test_the_papers_triangle_converges_to_a_wrong_plate():
    """Simply supported, uniform load: settled between meshes, and a quarter too soft for ever."""
    exact = 0.00406235
    coarse, fine = (plate_deflection(n, False, False, ElementChoice("cst", "paper")) for n in (16, 32))
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
