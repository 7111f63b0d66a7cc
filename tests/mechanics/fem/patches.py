"""Flat patches of distorted triangles, and states on them whose exact solution is known."""

import numpy as np

from trocar.services.mechanics.fem import ShellModel, ShellSection, Support
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.studies.published.shells import mapped_patch

NU = 0.3
SECTION = ShellSection(0.02, 2e5, NU, 1000.0)
STRAIN = {"stretch x": (1e-3, 0, 0), "stretch y": (0, 1e-3, 0), "shear": (0, 0, 1e-3)}
CURVATURE = {"bend x": (1e-2, 0, 0), "bend y": (0, 1e-2, 0), "twist": (0, 0, 2e-2)}


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


def constant_state(xyz, kind):
    """(n, 6) displacement and rotation of a state of STRAIN or CURVATURE at points of the xy plane."""
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


def constant_state_energy(kind):
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
    exact = constant_state(flat.vertices_m, kind).reshape(-1, 2, 3) @ R.T
    exact = exact.reshape(-1, 6)
    border = np.setdiff1d(np.arange(mesh.n_vertices), inner)
    model = ShellModel(mesh, SECTION, [Support(border)], elements)
    found = model.solve_static(np.zeros((mesh.n_vertices, 3)), imposed=exact)
    u = np.hstack([found.displacement_m, found.rotation_rad])
    energy = 0.5 * u.ravel() @ (model.K_full @ u.ravel())
    return np.abs(u - exact).max() / np.abs(exact).max(), energy


def in_plane_bending(xyz):
    """Exact plane-stress solution of a beam in pure bending: strains (y, -nu y, 0)."""
    x, y = xyz[:, 0], xyz[:, 1]
    u = np.zeros((len(x), 6))
    u[:, 0], u[:, 1], u[:, 5] = x * y, -0.5 * (x**2 + NU * y**2), -x
    return u


def biharmonic_deflection(xyz):
    """Exact unloaded plate: w = x⁴ - 6 x² y² + y⁴ + x³ - 3 x y²."""
    x, y = xyz[:, 0], xyz[:, 1]
    u = np.zeros((len(x), 6))
    u[:, 2] = x**4 - 6 * x**2 * y**2 + y**4 + x**3 - 3 * x * y**2
    u[:, 3] = -12 * x**2 * y + 4 * y**3 - 6 * x * y
    u[:, 4] = -(4 * x**3 - 12 * x * y**2 + 3 * x**2 - 3 * y**2)
    return u


def displacement_error(n, elements, exact_field):
    """Root mean square error inside a distorted square of n x n cells whose border follows the exact field."""
    mesh, inner = distorted_square(n, amount=0.2)
    exact = exact_field(mesh.vertices_m)
    border = np.setdiff1d(np.arange(mesh.n_vertices), inner)
    model = ShellModel(mesh, SECTION, [Support(border)], elements)
    found = model.solve_static(np.zeros((mesh.n_vertices, 3)), imposed=exact).displacement_m
    return np.sqrt(np.mean((found - exact[:, :3])[inner] ** 2))
