"""Accuracy of a solution: iterative refinement, the condition number, and the triangles that spoil it.

The stiffness of a stiff piece times its rigid motion is zero only to rounding. Where a piece is stiffer than what
holds it by more than about 1e6, that rounding weighs as much as the load, in the assembled matrix as in any residual
computed with it. Internal forces are therefore summed triangle by triangle from displacements in extended precision
less the triangle's rigid motion, and the solution is refined with them (mixed-precision iterative refinement:
Higham, Accuracy and Stability of Numerical Algorithms, ch. 12): it converges while condition times rounding is below
one.
"""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.assembly import ElementChoice, element_chunks
from trocar.services.mechanics.fem.section import ShellSection
from trocar.services.mechanics.surface.mesh import TriangleMesh, smallest_angles_rad

LongFloatArray: TypeAlias = npt.NDArray[np.longdouble]

MOST_ROUNDS = 40
"""Rounds of refinement; each gains at least a factor of two or is the last."""
TRANSLATIONS = [0, 1, 2, 6, 7, 8, 12, 13, 14]
"""Those among a triangle's 18 dofs."""


class IllConditionedError(ValueError):
    """The model's stiffness spans more than the digits of the computer; the sentence names the triangles."""


class Shell(Protocol):
    """The part of a `ShellModel` that this module reads."""

    mesh: TriangleMesh
    section: ShellSection
    elements: ElementChoice
    constraints: Literal["elimination", "penalty"]
    held_dofs: IntArray
    K_full: scipy.sparse.bsr_array[np.float64]

    @property
    def n_dofs(self) -> int:
        """Of all nodes."""

    @property
    def free_dofs(self) -> IntArray:
        """Those that no support holds."""

    @property
    def K_free(self) -> scipy.sparse.csc_array[np.float64]:
        """Stiffness over the free dofs."""

    @property
    def factor(self) -> scipy.sparse.linalg.SuperLU:
        """Its factors."""


def internal_forces(model: Shell, u: LongFloatArray) -> FloatArray:
    """(6 n,) forces in N and moments in N m that hold the shell at displacements ``u`` (6 n,)."""
    mesh = model.mesh
    force = np.zeros((mesh.n_vertices, 6))
    for chunk, K in element_chunks(mesh, model.section, model.elements):
        corners = mesh.triangles[chunk]
        d = _without_rigid_motion(mesh.vertices_m[corners].astype(np.longdouble), u.reshape(-1, 6)[corners])
        np.add.at(force, corners, (K @ d.reshape(-1, 18, 1)).reshape(-1, 3, 6))
    return force.ravel()


def _without_rigid_motion(x: LongFloatArray, u: LongFloatArray) -> FloatArray:
    """(m, 3, 6) displacements of corners ``x`` (m, 3, 3) less the rigid motion of each linear triangle."""
    a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    p, q = u[:, 1, :3] - u[:, 0, :3], u[:, 2, :3] - u[:, 0, :3]
    area_vector = np.cross(a, b)
    squared = np.sum(area_vector**2, axis=1, keepdims=True)
    normal = area_vector / np.sqrt(squared)
    dual_a, dual_b = np.cross(b, area_vector) / squared, np.cross(area_vector, a) / squared
    slope = np.sum(p * normal, axis=1, keepdims=True) * dual_a + np.sum(q * normal, axis=1, keepdims=True) * dual_b
    spin = 0.5 * np.sum(normal * (np.cross(dual_a, p) + np.cross(dual_b, q)), axis=1, keepdims=True)
    turn = np.cross(slope, normal) + spin * normal
    left = np.zeros(u.shape)
    left[:, 1, :3], left[:, 2, :3] = p - np.cross(turn, a), q - np.cross(turn, b)
    left[:, :, 3:] = u[:, :, 3:] - turn[:, None]
    return left


def refine(model: Shell, u: FloatArray, force: FloatArray, imposed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (6 n,) displacements and internal forces refined until the residual falls no further.

    Args:
        model, force: The shell, and the load (6 n,) on it.
        u: (6 n,) solution so far.
        imposed: (6 n,) displacements of the held dofs.
    """
    long = u.astype(np.longdouble)
    spring = np.zeros(model.n_dofs)
    if model.constraints == "penalty":
        spring[model.held_dofs] = (model.K_free.diagonal() - model.K_full.diagonal())[model.held_dofs]
    best = (long, internal_forces(model, long))
    least = np.inf
    for _ in range(MOST_ROUNDS):
        inside = internal_forces(model, long)
        missing = (force - inside - spring * (long - imposed)).astype(np.float64)[model.free_dofs]
        size = float(np.linalg.norm(missing))
        if not size < least:
            break
        best = (long, inside)
        if size > 0.5 * least:
            break
        least = size
        long = long.copy()
        long[model.free_dofs] += model.factor.solve(missing)
    return best[0].astype(np.float64), best[1]


def condition_estimate(model: Shell) -> float:
    """1-norm condition of the stiffness over the free dofs, scaled to a unit diagonal so that units do not matter.

    Higham and Tisseur's block estimate (SIAM J. Matrix Anal. Appl. 21:1185, 2000): seldom off by more than a factor of
    three; costs about ten solves with the factors. Where all is held there is nothing to solve, and it is one.
    """
    if not model.K_free.shape[0]:
        return 1.0
    scale = 1.0 / np.sqrt(model.K_free.diagonal())
    scaled_sums = scale * np.asarray(abs(model.K_free) @ scale)

    def inverse(x: FloatArray) -> FloatArray:
        columns = x.reshape(len(scale), -1)
        result: FloatArray = (model.factor.solve(columns / scale[:, None]) / scale[:, None]).reshape(x.shape)
        return result

    n = len(scale)
    operator = scipy.sparse.linalg.LinearOperator((n, n), inverse, inverse, inverse, np.float64, inverse)
    return float(scaled_sums.max() * scipy.sparse.linalg.onenormest(operator))


def stiffness_span(model: Shell) -> str:
    """Name the stiffest and the softest triangle in a clause: how much apart, where, and what they are made of."""
    chunks = element_chunks(model.mesh, model.section, model.elements)
    stiffness = np.concatenate([np.einsum("mii->mi", K)[:, TRANSLATIONS].sum(axis=1) for _, K in chunks])
    high, low = int(np.argmax(stiffness)), int(np.argmin(stiffness))
    return (
        f"stiffness of the triangles spans {stiffness[high] / stiffness[low]:.1g}, from {_describe(model, high)} to "
        f"{_describe(model, low)}"
    )


def _describe(model: Shell, triangle: int) -> str:
    mesh, section = model.mesh, model.section
    place_mm = np.round(1e3 * mesh.vertices_m[mesh.triangles[triangle]].mean(axis=0), 2) + 0.0
    angle_deg = np.degrees(smallest_angles_rad(mesh)[triangle])
    modulus, thickness = (
        section.per_triangle(name, mesh.n_triangles)[triangle] for name in ("youngs_modulus_pa", "thickness_m")
    )
    return (
        f"triangle {triangle} at {place_mm.tolist()} mm ({modulus:.3g} Pa, {1e3 * thickness:.3g} mm thick, sharpest "
        f"angle {angle_deg:.2g}°)"
    )
