"""Linear buckling: multiples of a load at which the stress it causes takes away all stiffness of some shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.fem.shell_model import ShellModel, StaticSolution
from trocar.studies.fem.geometric import geometric_stiffness, membrane_forces, pressure_stiffness

ESTIMATE = 0.01
"""Relative error to which the first load factor is estimated to place the shift."""
SHIFT = 0.9
"""Where the shift lies, over the estimate: below the first factor, so that no lower one hides behind it."""


@dataclass(frozen=True)
class BucklingModes:
    """Lowest load factors in ascending order, with the shapes that the shell buckles into.

    Attributes:
        load_factor: (k,) positive multiples of the load; above the first the shell is unstable.
        Phi: (n, 3, k) translations, the largest of each shape 1; zero at held dofs.
    """

    load_factor: FloatArray
    Phi: FloatArray


def compute_buckling(
    model: ShellModel, solution: StaticSolution, n_modes: int, pressure_pa: float = 0.0
) -> BucklingModes:
    """Lowest ``n_modes`` positive factors of K phi = -factor K_g phi.

    The state before buckling is the linear one: displacements are taken as small until then, so a shell that buckles
    at large deflections, or by imperfections as thin cylinders under axial load do, fails earlier than its factor.
    Raises ValueError if no positive multiple of the load buckles the shell while strains are small, or the model is
    ill-conditioned.

    Args:
        model, solution: The shell, and its equilibrium under the load.
        n_modes: How many factors; fewer come back where fewer are positive.
        pressure_pa: The part of the load that is a pressure inside: it stays normal to the wall as that moves.
    """
    free = model.free_dofs
    if len(free) < 2:
        raise ValueError(f"buckling: the supports leave {len(free)} dofs free, too few to buckle")
    if not 0 < n_modes < len(free):
        raise ValueError(f"buckling must lie between 1 and {len(free) - 1}, the free dofs, is {n_modes}")
    model.check_condition()
    forces = membrane_forces(model, solution)
    K_g = geometric_stiffness(model, forces)
    if pressure_pa:
        K_g = K_g + pressure_stiffness(model, pressure_pa)
    K_load = K_g.tocsr()[free][:, free]
    if not forces.any():
        raise ValueError("buckling: the loads stress this shell nowhere: they are zero, or all on supports")
    most = _factor_of_unit_strain(model, forces)
    if not _factors_below(model, K_load, most)[1]:
        raise ValueError("buckling: no multiple of the loads buckles this shell before it strains by 100 %")
    factors, shapes = _lowest_factors(model, K_load, n_modes)
    is_small = factors < most
    factors, shapes = factors[is_small], shapes[:, is_small]
    nodal = np.zeros((model.n_dofs, len(factors)))
    nodal[free] = shapes
    Phi = nodal.reshape(-1, 6, len(factors))[:, :3]
    return BucklingModes(factors, Phi / np.linalg.norm(Phi, axis=1).max(axis=0))


def _factor_of_unit_strain(model: ShellModel, forces: FloatArray) -> float:
    section, m = model.section, model.mesh.n_triangles
    rigidity = section.per_triangle("youngs_modulus_pa", m) * section.per_triangle("thickness_m", m)
    return float((rigidity / np.maximum(np.abs(forces).max(axis=1), 1e-300)).min())


def _factors_below(model: ShellModel, K_g: csr_array[np.float64], factor: float) -> tuple[SuperLU, int]:
    """Factors of K + factor K_g, and how many load factors lie below: as many as it has negative pivots (Sylvester)."""
    factors = factorise((model.K_free + factor * K_g).tocsc())
    return factors, int((factors.U.diagonal() < 0.0).sum())


def _lowest_factors(model: ShellModel, K_g: csr_array[np.float64], n_modes: int) -> tuple[FloatArray, FloatArray]:
    """Lanczos from a shift just below the first factor, which parts factors that lie close together.

    That first one is estimated without a shift to begin with; the signs of the pivots tell if the shift is too high.
    """
    n = len(model.free_dofs)
    start = np.random.default_rng(1).standard_normal(n)
    inverse = LinearOperator((n, n), matvec=model.factor.solve, dtype=np.float64)
    rough = eigsh(-K_g, 1, M=model.K_free, Minv=inverse, which="LA", v0=start, tol=ESTIMATE, return_eigenvectors=False)[
        0
    ]
    shift = SHIFT / rough
    shifted, below = _factors_below(model, K_g, shift)
    while below:
        shift *= 0.5
        shifted, below = _factors_below(model, K_g, shift)
    operator = LinearOperator((n, n), matvec=shifted.solve, dtype=np.float64)
    values, shapes = eigsh(model.K_free, n_modes, M=-K_g, sigma=shift, mode="buckling", v0=start, OPinv=operator)
    order = np.argsort(values)
    order = order[values[order] > 0.0]
    return values[order], shapes[:, order]
