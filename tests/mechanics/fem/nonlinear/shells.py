"""Shells of the literature on large displacements, on grids of any fineness."""

import numpy as np

from services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from services.mechanics.fem.nonlinear import CorotationalShell, NonlinearLoad
from services.mechanics.surface.mesh import TriangleMesh

ROOF_HINGED = ("ux", "uy", "uz")


def grid(place, n_u, n_v):
    """Triangles over the unit square mapped by ``place``, diagonals in turn, and the (n_u + 1, n_v + 1) vertices."""
    u, v = np.meshgrid(np.linspace(0, 1, n_u + 1), np.linspace(0, 1, n_v + 1), indexing="ij")
    vertices = np.stack(np.broadcast_arrays(*place(u.ravel(), v.ravel())), axis=1)
    index = np.arange(u.size, dtype=np.int32).reshape(u.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    turned = (np.add.outer(np.arange(n_u), np.arange(n_v)) % 2 == 1)[..., None]
    first = np.where(turned, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
    second = np.where(turned, np.stack([b, c, d], -1), np.stack([a, c, d], -1))
    triangles = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    return TriangleMesh(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(triangles)), index


def along_edge(n):
    """(n,) shares of a line load among equally spaced vertices."""
    weights = np.ones(n)
    weights[[0, -1]] = 0.5
    return weights / weights.sum()


def shell(mesh, thickness, modulus, poisson, supports, membrane="andes"):
    section = ShellSection(thickness, modulus, poisson, 1.0)
    return CorotationalShell(ShellModel(mesh, section, supports, ElementChoice(membrane, "dkt")))


def dead_load(mesh, **at):
    """Nodal load from ``component=(vertices, values)`` with components fx, fy, fz, mx, my, mz."""
    dead = np.zeros((mesh.n_vertices, 6))
    for name, (vertices, values) in at.items():
        dead[vertices, ("fx", "fy", "fz", "mx", "my", "mz").index(name)] += values
    return NonlinearLoad(dead, 0.0, np.zeros_like(dead))


def cantilever(n_along=16, membrane="cst"):
    """L 10, W 1, t 0.1, E 1.2e6, nu 0 (Sze, Liu and Lo 2004); returns shell, mesh and vertices."""
    mesh, index = grid(lambda u, v: (10.0 * u, v, 0.0 * u), n_along, 2)
    return shell(mesh, 0.1, 1.2e6, 0.0, [Support(index[0])], membrane), mesh, index


def hinged_roof(thickness, n=8):
    """A quarter of the cylindrical roof R 2540, L 508, theta 0.1, E 3102.75, nu 0.3; straight edges hinged."""
    mesh, index = grid(lambda u, v: (2540.0 * np.sin(0.1 * u), 254.0 * v, 2540.0 * (np.cos(0.1 * u) - 1.0)), n, n)
    supports = [
        Support(index[-1], ROOF_HINGED),
        Support(index[0], ("ux", "ry", "rz")),
        Support(index[:, 0], ("uy", "rx", "rz")),
    ]
    return shell(mesh, thickness, 3102.75, 0.3, supports), mesh, index
