"""The nonlinear membrane on linear modes alone, its in-plane relaxation folded into the polynomial.

With modal derivatives as coordinates of their own the model is more general but stiff: their frequencies (300 to
1000 Hz on a duct) forbid a step of 1 ms. Here they follow the modes statically, u = Phi q + Theta(q, q), with Theta
the response to the stress of the products of the modes' gradients (a quadratic manifold: Jain et al. 2017; implicit
condensation). The energy is von Karman's on that manifold,

    E = |e(Phi q) + e(Theta) + eta(Phi q) / 2|^2 / 2 + bending,

a complete square: it is never negative, whatever the amplitude, so the polynomial cannot run away downhill. That holds
only if the linear strain has no more energy than the linear modes, which may be of a softer element.
The quartic part is what a bent wall keeps after it has found its in-plane equilibrium, so nothing locks, and its
tangent stays within what an explicit kick of 1 ms bears up to deflections of several radii.

Left out is the part of the relaxation that is due to the modes' own membrane strain: local snap-through of a
pinched wall is not in this model (docs/decisions/nonlinear-membrane.md).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ElementChoice, ShellModel
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.cache import fetch_record
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.reduction.free_dofs import free_load
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial, energy_tensors
from trocar.services.mechanics.reduction.recipe import DuctRecipe


def relaxed_membrane_force(model: ShellModel, basis: ModalBasis, n_coordinates: int) -> MembranePolynomial:
    """Return the membrane force of the lowest ``n_coordinates`` modes, in-plane motion relaxed.

    Raises ValueError if the model has another membrane element, or the basis fewer modes.

    Args:
        model: ShellModel. With the membrane element ``cst``, whose strains the nonlinear energy has: only then is the
            energy a complete square.
        basis: ModalBasis. Linear modes, of this model or of one with a better membrane.
        n_coordinates: int. How many of the lowest modes take part, up to 30; the others stay linear.
    """
    if model.elements.membrane != "cst":
        raise ValueError(f"the nonlinear membrane needs the element 'cst', not '{model.elements.membrane}'")
    if not 0 < n_coordinates <= basis.n_modes:
        raise ValueError(f"{n_coordinates} nonlinear coordinates do not fit a basis of {basis.n_modes} modes")
    shapes = np.ascontiguousarray(basis.Phi[:, :, :n_coordinates])
    third, fourth = energy_tensors(Membrane.from_model(model), shapes)
    displacements = np.stack([free_load(model, shapes[:, :, k]) for k in range(n_coordinates)], axis=1)
    held = _static_forces(model, displacements)
    softer = _softened_strain(displacements.T @ held, basis.omega_rad_s[:n_coordinates])
    relaxed = fourth - _relaxation_energy(model, shapes, held)
    return MembranePolynomial.from_energies(np.arange(n_coordinates, dtype=np.int32), softer.T @ third, relaxed)


def fetch_membrane_force(
    recipe: DuctRecipe,
    basis: ModalBasis,
    n_coordinates: int,
    cache_dir: Path | None = None,
    progress: Progress = ignore_progress,
) -> MembranePolynomial:
    """Return the relaxed membrane force of a recipe's duct, from the cache where it is there."""

    def make() -> MembranePolynomial:
        progress("nonlinear membrane", 0.0)
        elements = ElementChoice("cst", recipe.elements.bending)
        model = ShellModel(recipe.mesh, recipe.section, recipe.supports, elements)
        force = relaxed_membrane_force(model, basis, n_coordinates)
        progress("nonlinear membrane", 1.0)
        return force

    name = entry_name("membrane", __name__, basis.content_hash, recipe.key(), n_coordinates)
    return fetch_record(cache_dir, name, MembranePolynomial, make, content_hash=basis.content_hash)


def _static_forces(model: ShellModel, displacements: FloatArray) -> FloatArray:
    """Return the loads (f, s) that hold the wall in each of the displacements (f, s), its rotations free."""
    x = displacements.copy()
    rotations = np.setdiff1d(np.arange(len(x)), model.free_translations)
    rows = model.K_free[rotations]
    x[rotations] = factorise(rows[:, rotations].tocsc()).solve(-np.asarray(rows @ x))
    return np.asarray(model.K_free @ x)


def _softened_strain(stiffness: FloatArray, omega_rad_s: FloatArray) -> FloatArray:
    """Return the map (s, s) of coordinates whose linear strain is no stiffer than the linear modes.

    ``stiffness`` (s, s) is that of the modes' shapes with the element ``cst``, which may be stiffer than the element of
    the modes. With its strain the energy would be negative where a wall
    is stretched far, so that strain is reduced, along the eigenvectors of one stiffness relative to the other, until
    both agree. With modes of this model it is the identity.
    """
    stiffer, vectors = np.linalg.eigh(stiffness / np.outer(omega_rad_s, omega_rad_s))
    reduced: FloatArray = (vectors / np.sqrt(np.maximum(stiffer, 1.0))) @ vectors.T
    return reduced * (omega_rad_s / omega_rad_s[:, None])


def _relaxation_energy(model: ShellModel, shapes: FloatArray, held: FloatArray) -> FloatArray:
    """Return the energy (p, p) over pairs of modes that the wall sheds by moving in its plane.

    Theta minimises b.Theta + Theta.K Theta / 2 with b the forces of the product stresses. Multipliers keep it from
    working against the static forces ``held`` (f, s) of the modes: their motion is in q already.
    """
    forces = _product_forces(model, shapes)
    response, held_response = model.factor.solve(forces), model.factor.solve(held)
    excess = held.T @ response
    taken_back = excess.T @ np.linalg.solve(held.T @ held_response, excess)
    energy: FloatArray = 0.5 * (forces.T @ response - taken_back)
    return energy


def _product_forces(model: ShellModel, shapes: FloatArray) -> FloatArray:
    """Return the loads (f, p) of the stresses D eta / 2 of each pair of modes, twice for unequal ones."""
    membrane = Membrane.from_model(model)
    columns = []
    for j, k in zip(*np.triu_indices(shapes.shape[2]), strict=True):
        force = membrane.product_force_n(shapes[:, :, j], shapes[:, :, k])
        columns.append((1.0 if j == k else 2.0) * free_load(model, force))
    return np.stack(columns, axis=1)
