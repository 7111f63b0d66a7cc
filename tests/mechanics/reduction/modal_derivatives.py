"""Modal derivatives: the shapes that a wall needs, beyond its linear modes, to deform far without false stiffness.

A linear mode bends a wall without the in-plane motion that keeps its length, so a nonlinear membrane on linear
modes alone locks. How the modes change as the wall deforms, psi_ij = -2 K^-1 B(phi_i, phi_j), supplies that motion
(Barbic and James 2005, section 5.1). As coordinates of their own they are stiff: an explicit step must stay below
0.25 ms on a typical duct. The 1 kHz step uses `manifold`; this basis is the more general model it is checked against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, svd

from tests.mechanics.reduction.exact_membrane import ExactMembrane
from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial, energy_tensors
from trocar.studies.full_model import CondensedStiffness


@dataclass(frozen=True, slots=True)
class NonlinearBasis:
    """Linear modes and derivatives in one basis, and which of its coordinates the nonlinear force acts in.

    Attributes
    ----------
    basis : ModalBasis
        Mass normalised and diagonal in K like any other, so every integrator and the residual take it as it is.
    coordinates : (s,) int32
        The modes that were differentiated, and the derivatives.
    """

    basis: ModalBasis
    coordinates: IntArray


def extend_with_derivatives(
    model: ShellModel, linear: ModalBasis, n_differentiated: int, n_derivatives: int
) -> NonlinearBasis:
    """Add the ``n_derivatives`` weightiest combinations of the derivatives of the lowest modes to a linear basis.

    Derivatives are weighed by 1 / (lambda_i lambda_j), the size of the coordinates that the same load excites,
    and combined by principal components in the norm of the mass. Mass-orthogonal to the linear modes, they are
    orthogonal to them in K as well; among themselves they are turned to be diagonal in K.
    """
    derivatives = modal_derivatives(model, linear, n_differentiated)
    root_mass = np.sqrt(model.mass_kg)[:, None, None]
    r = linear.n_modes
    modes = (root_mass * linear.Phi).reshape(-1, r)
    candidates = (root_mass * derivatives).reshape(modes.shape[0], -1)
    for _ in range(2):
        candidates -= modes @ (modes.T @ candidates)
    components = svd(candidates, full_matrices=False)[0][:, :n_derivatives]
    shapes = components.reshape(-1, 3, components.shape[1]) / root_mass
    omega, turned = _diagonalise(model, shapes)
    order = np.argsort(np.concatenate([linear.omega_rad_s, omega]), kind="stable")
    basis = ModalBasis.from_modes(
        np.concatenate([linear.omega_rad_s, omega])[order], np.concatenate([linear.Phi, turned], axis=2)[:, :, order]
    )
    active = np.flatnonzero((order < n_differentiated) | (order >= r))
    return NonlinearBasis(basis, active.astype(np.int32))


def cubic_force(membrane: Membrane, nonlinear: NonlinearBasis) -> MembranePolynomial:
    """Return the membrane's force in the coordinates of a nonlinear basis, its coefficients summed over the mesh."""
    shapes = np.ascontiguousarray(nonlinear.basis.Phi[:, :, nonlinear.coordinates])
    third, fourth = energy_tensors(membrane, shapes)
    return MembranePolynomial.from_energies(nonlinear.coordinates, third, fourth)


def modal_derivatives(model: ShellModel, linear: ModalBasis, n_modes: int) -> FloatArray:
    """Return psi_ij / (lambda_i lambda_j), (n, 3, p), for the pairs i <= j of the lowest ``n_modes``."""
    membrane = ExactMembrane.from_model(model)
    loads = []
    for i in range(n_modes):
        for j in range(i, n_modes):
            force = membrane.quadratic_force_n(linear.Phi[:, :, i], linear.Phi[:, :, j])
            loads.append(-2.0 * free_load(model, force) / (linear.omega_rad_s[i] * linear.omega_rad_s[j]) ** 2)
    return nodal_translations(model, model.factor.solve(np.stack(loads, axis=1)))


def _diagonalise(model: ShellModel, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (d,) and shapes (n, 3, d) spanning mass-orthonormal ``shapes``, diagonal in K."""
    stiffness = CondensedStiffness(model)
    load = np.stack([free_load(model, shapes[:, :, k])[stiffness.translations] for k in range(shapes.shape[2])])
    K = np.array([[float(a @ stiffness.apply(b)) for b in load] for a in load])
    squared, turn = eigh(0.5 * (K + K.T))
    return np.sqrt(squared), shapes @ turn
