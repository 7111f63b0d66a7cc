"""Newton's method for one equilibrium of a corotational shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.nonlinear.corotational import Configuration, CorotationalShell
from trocar.services.mechanics.fem.nonlinear.follower_loads import NonlinearLoad

MOST_ITERATIONS = 25
PIVOT_THRESHOLD = 1e-3
"""Pivots from the diagonal unless they are tiny: the tangent is nearly symmetric, and definite on stable paths. Without
symmetric mode the factors of a duct have sixteen times as many entries, and as many again where newtons and newton
metres stand side by side: against a diagonal of 1 only what is nearly singular is tiny."""
LARGEST_SPIN_RAD = 0.5
"""Of a node in one iteration: beyond it the logarithm of a triangle's rotations may jump."""


class NotConvergedError(Exception):
    """No equilibrium within the iterations allowed."""


@dataclass(frozen=True)
class Equilibrium:
    """What Newton's method ended with; see `equilibrium.PathPoint`."""

    at: Configuration
    reaction: FloatArray
    iterations: int
    residual: float


@dataclass(frozen=True)
class Factors:
    """Factors of K over the free dofs, scaled from both sides to a diagonal of 1."""

    lu: SuperLU
    scale: FloatArray

    @classmethod
    def of(cls, K: csr_array[np.float64]) -> Self:
        """Factorise; raises RuntimeError where K is singular."""
        diagonal = np.abs(K.diagonal())
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        scaled = (diags_array(scale) @ K @ diags_array(scale)).tocsc()
        options = {"SymmetricMode": True}
        return cls(splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT_THRESHOLD, options=options), scale)

    def solve(self, right: FloatArray) -> FloatArray:
        """(n,) x with K x = ``right``."""
        return self.scale * self.lu.solve(self.scale * right)


class Newton:
    """Solver of one shell under parts of one load."""

    def __init__(self, shell: CorotationalShell, load: NonlinearLoad, tolerance: float) -> None:
        self.shell = shell
        self.load = load
        self.tolerance = tolerance
        self.free = shell.model.free_dofs
        self.held = shell.model.held_dofs
        imposed = load.imposed.ravel()
        self.imposed: FloatArray = imposed[self.held]
        model = shell.model
        size = np.zeros((model.mesh.n_vertices, 6))
        size[:, :3] = np.abs(model.mesh.vertices_m - model.mesh.vertices_m.mean(axis=0))
        rounding = np.finfo(np.float64).eps * np.asarray(abs(model.K_full) @ size.ravel())
        self._rounding_n = float(np.linalg.norm(rounding))

    def solve(self, start: Configuration, part_now: float, part: float) -> Equilibrium:
        """Equilibrium at ``part`` of the load, from one at ``part_now``.

        Raises NotConvergedError if the residual did not fall below the tolerance.
        """
        at, to_impose = start, (part - part_now) * self.imposed
        residual, carried = np.inf, None
        for iteration in range(MOST_ITERATIONS):
            inside = self.shell.forces(at)
            unbalanced = part * self.load.forces(self.shell.model.mesh, at.position_m) - inside
            residual = self.residual(unbalanced, inside)
            if residual <= self.tolerance and not to_impose.any():
                return Equilibrium(at, self.reaction(unbalanced), iteration, residual)
            K = self.tangent(at, part, carried)
            step = np.zeros(len(inside))
            step[self.held] = to_impose
            right = unbalanced[self.free] - np.asarray(K @ step)[self.free]
            step[self.free] = self.factorise(K).solve(right)
            step *= self._length(step)
            carried = self.shell.carried_after(at, step)
            at = at.moved(step)
            to_impose = np.zeros(len(self.held))
        raise NotConvergedError(f"residual {residual:.1g} after {MOST_ITERATIONS} iterations")

    def tangent(self, at: Configuration, part: float, carried: FloatArray | None) -> csr_array[np.float64]:
        """Derivative of what is unbalanced with its sign turned; see `CorotationalShell.tangent` for ``carried``."""
        tangent = self.shell.tangent(at, carried)
        if self.load.pressure_pa:
            tangent = tangent + part * self.load.stiffness(self.shell.model.mesh, at.position_m)
        return tangent.tocsr()

    def factorise(self, K: csr_array[np.float64]) -> Factors:
        """Factors over the free dofs: the tangent may be neither symmetric nor definite.

        Raises NotConvergedError if it is singular.
        """
        try:
            return Factors.of(K[self.free][:, self.free])
        except RuntimeError as error:
            raise NotConvergedError("the tangent is singular") from error

    def residual(self, unbalanced: FloatArray, inside: FloatArray) -> float:
        """Unbalanced force at free dofs over all forces at nodes; moments count by the mesh's size.

        What rounding of the nodes' positions leaves unbalanced counts as within the tolerance.
        """
        scale = self._norm(inside) + self._norm(unbalanced + inside)
        free = np.zeros(len(unbalanced))
        free[self.free] = unbalanced[self.free]
        return self._norm(free) / max(scale, self._rounding_n / self.tolerance)

    def _norm(self, vector: FloatArray) -> float:
        nodal = vector.reshape(-1, 6).copy()
        nodal[:, 3:] /= np.linalg.norm(np.ptp(self.shell.model.mesh.vertices_m, axis=0))
        return float(np.linalg.norm(nodal))

    def reaction(self, unbalanced: FloatArray) -> FloatArray:
        """(n, 6) forces of the supports."""
        reaction = np.zeros(len(unbalanced))
        reaction[self.held] = -unbalanced[self.held]
        return reaction.reshape(-1, 6)

    def _length(self, step: FloatArray) -> float:
        turned = np.abs(step.reshape(-1, 6)[:, 3:]).max()
        return min(1.0, LARGEST_SPIN_RAD / float(turned)) if turned else 1.0
