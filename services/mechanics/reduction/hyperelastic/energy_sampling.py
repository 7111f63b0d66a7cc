"""Which triangles stand for the wall, and how much each counts: energy-conserving sampling and weighting.

Farhat, Avery, Chapman and Cortial (IJNME 98:625, 2014): few triangles with weights that are not negative, such that
the forces of the stiffening under many loads come out. What is sampled is an energy, so the force has a potential
whatever the weights are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel, pressure_load
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.cache import fetch_record
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.reduction.hyperelastic.equilibrium import rest_shape
from trocar.services.mechanics.reduction.hyperelastic.stretch_loads import stretch_loads
from trocar.services.mechanics.reduction.hyperelastic.wall_strain import taken_strain
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.surface.mesh import vertex_normals

SEED = 1
"""Any one, so that each build of a wall draws the same."""
PLACES = 40
"""Places on the wall that the loads of the training press and pull at, along three directions."""
LARGEST_Q = (0.2, 1.0, 3.0)
"""Largest Q, the form of the strain over `MembraneLaw.unit_form`, of the states under such loads, in turn."""
STRETCHED = 120
"""Rest shapes of the training under pressures and pulls along the wall, even by a third and mostly of one kind."""
STRETCHED_Q = (0.2, 1.0, 4.0, 30.0, 120.0)
"""Largest Q that the linear wall would have under these, in turn: to 2.5 of the one that stiffens."""
BUCKETS = 1600
"""Sums, with random signs, of the forces on modes: as hard to fool as each of them alone."""
TOLERANCE = 0.0005
MOST_SAMPLES = 160
"""Of a wall: of a duct inflated to a hoop strain of 0.2, displacements are 7.4 % off with 80 of 1,152 triangles, 3.4 %
with 110, 2.0 % with these, and 1.5 % with all."""


@dataclass(frozen=True, slots=True)
class StretchSamples:
    """Triangles that stand for the wall.

    Attributes:
        strain: (3 k, r) float64. Strain of each sample per modal coordinate, as the law takes it.
        energy_j: (k,) float64. Modulus along the wall times volume times weight.
        law: BeyondLinear. Its response is multiplied by these energies.
    """

    strain: FloatArray
    energy_j: FloatArray
    law: BeyondLinear


def fetch_samples(
    recipe: DuctRecipe,
    basis: ModalBasis,
    law: BeyondLinear,
    cache_dir: Path | None = None,
    progress: Progress = ignore_progress,
) -> StretchSamples:
    """Return the samples of a recipe's wall, from the cache where they are there."""

    def make() -> StretchSamples:
        progress("stretch of the wall", 0.0)
        samples = choose_samples(recipe.model(), basis, law)
        progress("stretch of the wall", 1.0)
        return samples

    name = entry_name("stretch", __name__, basis.content_hash, recipe.key(), law.number, law.parameters)
    return fetch_record(cache_dir, name, StretchSamples, make, content_hash=basis.content_hash)


def choose_samples(model: ShellModel, basis: ModalBasis, law: BeyondLinear) -> StretchSamples:
    """Choose triangles and weights of a wall with this law."""
    every = every_triangle(model, basis, law)
    strain = every.strain.reshape(-1, 3, basis.n_modes)
    states = np.concatenate([_states(every, _loads(model), basis), _stretched(every, model, basis)], axis=1)
    works = _forces(every, states, basis.omega_rad_s)
    chosen, weights = sparse_weights(works, works.sum(axis=1), TOLERANCE, MOST_SAMPLES)
    return StretchSamples(
        np.ascontiguousarray(strain[chosen].reshape(-1, basis.n_modes)), weights * every.energy_j[chosen], law
    )


def every_triangle(model: ShellModel, basis: ModalBasis, law: BeyondLinear) -> StretchSamples:
    """Return the wall unsampled."""
    membrane = Membrane.from_model(model)
    taken, energy_j = taken_strain(model, law)
    gradient = np.einsum("man,mnir->mair", membrane.gradients, basis.Phi[membrane.triangles], optimize=True)
    mixed = np.einsum("mai,mbir->mabr", membrane.tangents, gradient, optimize=True)
    strain = np.stack([mixed[:, 0, 0], mixed[:, 1, 1], mixed[:, 0, 1] + mixed[:, 1, 0]], axis=1)
    return StretchSamples((taken @ strain).reshape(-1, basis.n_modes), energy_j, law)


def sparse_weights(works: FloatArray, total: FloatArray, tolerance: float, most: int) -> tuple[IntArray, FloatArray]:
    """Return few columns of ``works`` and weights >= 0 whose sum is nearly ``total``.

    The least squares of Lawson and Hanson, ended as soon as the residual is below ``tolerance`` times ``total`` or
    ``most`` columns are chosen.
    """
    chosen: list[int] = []
    weights: FloatArray = np.zeros(0)
    residual = total.copy()
    for _ in range(3 * most):
        if np.linalg.norm(residual) <= tolerance * np.linalg.norm(total) or len(chosen) == most:
            break
        gain = works.T @ residual
        gain[chosen] = -np.inf
        chosen, weights = [*chosen, int(gain.argmax())], np.append(weights, 0.0)
        while True:
            wanted: FloatArray = np.asarray(np.linalg.lstsq(works[:, chosen], total, rcond=None)[0], np.float64)
            if (wanted > 0.0).all():
                weights = wanted
                break
            wrong = wanted <= 0.0
            step = np.min(weights[wrong] / np.maximum(weights[wrong] - wanted[wrong], 1e-300))
            weights = weights + step * (wanted - weights)
            keep = weights > 1e-12 * weights.max()
            keep[wrong & (weights <= 1e-12 * max(weights.max(), 1e-300))] = False
            chosen, weights = [c for c, k in zip(chosen, keep, strict=True) if k], weights[keep]
        residual = total - works[:, chosen] @ weights
    return np.array(chosen, np.int32), weights


def _loads(model: ShellModel) -> FloatArray:
    """(s, n, 3) pressure, weights along the axes, and forces at places all over the free wall."""
    mesh = model.mesh
    free = np.flatnonzero(model.mass_kg > 0.0)
    places = free[np.linspace(0, len(free) - 1, min(PLACES, len(free))).astype(int)]
    normals = vertex_normals(mesh)
    loads = [pressure_load(mesh, 1.0)]
    loads += [model.mass_kg[:, None] * axis for axis in np.eye(3)]
    for place in places:
        near = np.argsort(np.linalg.norm(mesh.vertices_m - mesh.vertices_m[place], axis=1))[:6]
        for direction in (normals[place], *np.eye(3)[:2]):
            load = np.zeros((mesh.n_vertices, 3))
            load[near] = direction
            loads.append(load)
    return np.stack(loads)


def _states(every: StretchSamples, loads: FloatArray, basis: ModalBasis) -> FloatArray:
    """(r, s) modal coordinates at rest under the loads, of which the largest Q is given."""
    states = np.einsum("nar,sna->rs", basis.Phi, loads, optimize=True) / basis.omega_rad_s[:, None] ** 2
    strain = (every.strain @ states).reshape(-1, 3, states.shape[1])
    largest = np.sum(strain**2, axis=1).max(axis=0) / every.law.unit_form
    states, largest = states[:, largest > 0.0], largest[largest > 0.0]
    scaled: FloatArray = states * np.sqrt(np.resize(LARGEST_Q, len(largest)) / largest)
    return scaled


def _stretched(every: StretchSamples, model: ShellModel, basis: ModalBasis) -> FloatArray:
    """(r, s) modal coordinates at rest under random sums of the loads that stretch the wall as a whole."""
    random = np.random.default_rng(SEED)
    groups = stretch_loads(model)
    single = np.einsum("nar,kna->kr", basis.Phi, np.concatenate(groups), optimize=True)
    single /= np.linalg.norm(single / basis.omega_rad_s, axis=1)[:, None]
    sizes = [len(group) for group in groups]
    states = []
    for largest in np.resize(STRETCHED_Q, STRETCHED):
        mostly_one = np.repeat(random.standard_normal(len(sizes)) ** 3, sizes)
        force = (mostly_one * (1.0 + 0.3 * random.standard_normal(len(single)))) @ single
        strain = (every.strain @ (force / basis.omega_rad_s**2)).reshape(-1, 3)
        force *= np.sqrt(largest * every.law.unit_form / np.sum(strain**2, axis=1).max())
        states.append(rest_shape(every.strain, every.energy_j, every.law, basis.omega_rad_s, force))
    return np.stack(states, axis=1)


def _forces(every: StretchSamples, states: FloatArray, omega_rad_s: FloatArray) -> FloatArray:
    """(p, m) parts of every triangle in the forces on modes in states (r, s), over what would move all modes alike.

    A soft mode, which hardly stretches the wall, would be moved far by a small error of its force. The last rows are
    the work of the forces of each state as that grows, over its sum: what a load does on the way there.
    """
    random, strain = np.random.default_rng(SEED), every.strain.reshape(-1, 3, len(omega_rad_s))
    forces = np.zeros((min(BUCKETS, states.size), strain.shape[0]))
    works = np.zeros((states.shape[1], strain.shape[0]))
    for state, work in zip(states.T, works, strict=True):
        stretch = strain @ state
        _, stress, _ = every.law.respond(stretch)
        work[:] = every.energy_j * np.sum(stress * stretch, axis=1)
        work /= work.sum()
        force = np.einsum("ma,mar->rm", every.energy_j[:, None] * stress, strain) / omega_rad_s[:, None] ** 2
        force *= random.choice((-1.0, 1.0), size=(len(force), 1)) / np.linalg.norm(force.sum(axis=1))
        np.add.at(forces, random.integers(len(forces), size=len(force)), force)
    return np.concatenate([forces, works])
