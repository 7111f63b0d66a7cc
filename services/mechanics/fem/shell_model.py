"""A supported shell: stiffness and mass over its free degrees of freedom, factorised once and solved often."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.assembly import ElementChoice, assemble_lumped_mass, assemble_stiffness
from trocar.services.mechanics.fem.boundary_conditions import Support, check_supported, held_dofs
from trocar.services.mechanics.fem.conditioning import IllConditionedError, condition_estimate, refine, stiffness_span
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.fem.memory import check_memory
from trocar.services.mechanics.fem.section import ShellSection
from trocar.services.mechanics.fem.thinness import check_thin
from trocar.services.mechanics.surface.mesh import TriangleMesh

__all__ = ["ElementChoice", "ShellModel", "StaticSolution"]

RESIDUAL_LIMIT = 1e-8
"""A static solution with a larger residual is refined, and refused if that does not heal it."""
CONDITION_LIMIT = 1e12
"""As doubles are rounded by 1e-16, modes and load factors, which nothing refines, are wrong in the fourth digit."""
PENALTY = 1e8
"""The paper's "large number" on the held diagonal entries; beyond it the factorisation loses digits."""


@dataclass(frozen=True)
class StaticSolution:
    """Equilibrium under one load case.

    Attributes:
        displacement_m: (n, 3).
        rotation_rad: (n, 3) small rotation vectors.
        reaction: (n, 6) force (N) and moment (N m) that the supports exert on the shell, zero at free dofs.
        residual: Norm of the unbalanced free forces over that of load and reactions, at most `RESIDUAL_LIMIT`.
    """

    displacement_m: FloatArray
    rotation_rad: FloatArray
    reaction: FloatArray
    residual: float


class ShellModel:
    """Thin shell with supports; dof 6 * node + component, components (ux, uy, uz, rx, ry, rz) in global axes.

    Raises ValueError if the mesh is too large, degenerate, thicker than wide, or not supported; the message says where.

    Args:
        mesh, section, elements: Geometry, material and the triangles that carry it.
        supports: Held degrees of freedom; every connected piece must be kept from moving rigidly.
        constraints: ``elimination`` removes held dofs; ``penalty`` keeps them and multiplies their diagonal (paper,
            II-C.1 d).
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        section: ShellSection,
        supports: Sequence[Support],
        elements: ElementChoice | None = None,
        constraints: Literal["elimination", "penalty"] = "elimination",
    ) -> None:
        self.mesh = mesh
        self.section = section
        self.elements = elements or ElementChoice()
        self.constraints = constraints
        check_memory(mesh.n_vertices)
        self.held_dofs: IntArray = held_dofs(mesh, supports)
        check_supported(mesh, self.held_dofs)
        check_thin(mesh, section)
        self.K_full = assemble_stiffness(mesh, section, self.elements)
        self.mass_kg: FloatArray = assemble_lumped_mass(mesh, section)

    @property
    def n_dofs(self) -> int:
        """All degrees of freedom, 6 n."""
        return 6 * self.mesh.n_vertices

    @cached_property
    def free_dofs(self) -> IntArray:
        """(f,) indices of the unknowns: not held, or all of them with the penalty method."""
        if self.constraints == "penalty":
            return np.arange(self.n_dofs, dtype=np.int32)
        return np.setdiff1d(np.arange(self.n_dofs, dtype=np.int32), self.held_dofs, assume_unique=True)

    @cached_property
    def K_free(self) -> scipy.sparse.csc_array[np.float64]:
        """(f, f) stiffness over the free dofs, symmetric positive definite."""
        K = self.K_full.tocsr()
        if self.constraints == "elimination":
            K = K[self.free_dofs][:, self.free_dofs]
        # Symmetric: the compressed rows are the compressed columns.
        compressed = scipy.sparse.csc_array((K.data, K.indices, K.indptr), shape=K.shape)
        if self.constraints == "penalty":
            diagonal = compressed.diagonal()
            diagonal[self.held_dofs] *= PENALTY
            compressed.setdiag(diagonal)
        return compressed

    @cached_property
    def free_translations(self) -> IntArray:
        """Positions within ``free_dofs`` of the unknowns that are translations."""
        return np.flatnonzero(self.free_dofs % 6 < 3).astype(np.int32)

    @cached_property
    def free_mass_kg(self) -> FloatArray:
        """(f,) diagonal of the mass matrix over the free dofs; rotations carry none."""
        mass = np.zeros((self.mesh.n_vertices, 6))
        mass[:, :3] = self.mass_kg[:, None]
        return mass.ravel()[self.free_dofs]

    @cached_property
    def factor(self) -> scipy.sparse.linalg.SuperLU:
        """Sparse factors of ``K_free``, made at the first use.

        Raises IllConditionedError if a pivot is zero; names the triangles whose stiffness is furthest apart.
        """
        try:
            return factorise(self.K_free)
        except RuntimeError as error:
            raise IllConditionedError(f"the stiffness is singular in floating point: {stiffness_span(self)}") from error

    @cached_property
    def condition(self) -> float:
        """Estimate of the scaled condition of ``K_free``: times 2e-16 it is the relative error to reckon with."""
        return condition_estimate(self)

    def check_condition(self) -> None:
        """Refuse an analysis that needs a well-conditioned model.

        Raises IllConditionedError if `condition` is beyond `CONDITION_LIMIT`; names the triangles whose stiffness is
        furthest apart.
        """
        if not self.condition <= CONDITION_LIMIT:
            raise IllConditionedError(f"condition {self.condition:.1g} leaves no digits: {stiffness_span(self)}")

    def solve_free(self, load: FloatArray) -> FloatArray:
        """K⁻¹ load for (f,) or (f, k) loads over the free dofs, with one step of iterative refinement."""
        u = self.factor.solve(load)
        u += self.factor.solve(load - self.K_free @ u)
        return u

    def solve_static(self, load: FloatArray, imposed: FloatArray | None = None) -> StaticSolution:
        """Equilibrium under nodal loads and displacements imposed on the held dofs.

        Raises IllConditionedError: the residual stays above `RESIDUAL_LIMIT` after refinement; names the triangles that
        cause it.

        Args:
            load: (n, 3) forces in N or (n, 6) with moments in N m.
            imposed: (n, 6) values of which those at held dofs are used; none means zero.
        """
        force = self._full_vector(load, "load")
        u = np.zeros(self.n_dofs)
        if imposed is not None:
            u[self.held_dofs] = self._full_vector(imposed, "imposed")[self.held_dofs]
        imposed_u = u.copy()
        free = self.free_dofs
        if self.constraints == "penalty":
            target = force.copy()
            target[self.held_dofs] = self.K_free.diagonal()[self.held_dofs] * u[self.held_dofs]
            u = self.solve_free(target)
        else:
            u[free] = self.solve_free((force - np.asarray(self.K_full @ u))[free])
        inside = np.asarray(self.K_full @ u)
        residual = self._residual(force, inside, u)
        if not residual <= RESIDUAL_LIMIT:
            u, inside = refine(self, u, force, imposed_u)
            residual = self._residual(force, inside, u)
            if not residual <= RESIDUAL_LIMIT:
                raise IllConditionedError(
                    f"static solution: the residual stays at {residual:.1g} of the load (condition "
                    f"{self.condition:.1g}): {stiffness_span(self)}"
                )
        reaction = np.zeros(self.n_dofs)
        reaction[self.held_dofs] = (inside - force)[self.held_dofs]
        nodal = u.reshape(-1, 6)
        return StaticSolution(nodal[:, :3].copy(), nodal[:, 3:].copy(), reaction.reshape(-1, 6), residual)

    def _residual(self, force: FloatArray, inside: FloatArray, u: FloatArray) -> float:
        """Norm of what is unbalanced at free dofs over the norms of load and reactions.

        Where nothing is loaded and the supports impose a rigid motion both are rounding: forces below the rounding of
        the stiffness's own entries then count as none.
        """
        unbalanced = force - inside
        reaction = np.linalg.norm(unbalanced[self.held_dofs])
        unbalanced[self.held_dofs] = 0.0
        scale = float(np.linalg.norm(force) + reaction)
        if not force.any():
            rounding = np.finfo(np.float64).eps * np.linalg.norm(abs(self.K_full) @ np.abs(u))
            scale = max(scale, 0.01 * rounding / RESIDUAL_LIMIT)
        return float(np.linalg.norm(unbalanced)) / scale if scale else 0.0

    def _full_vector(self, nodal: FloatArray, name: str) -> FloatArray:
        n = self.mesh.n_vertices
        if nodal.shape not in ((n, 3), (n, 6)):
            raise ValueError(f"{name} has shape {nodal.shape}, expected ({n}, 3) or ({n}, 6)")
        full = np.zeros((n, 6))
        full[:, : nodal.shape[1]] = nodal
        return full.ravel()
