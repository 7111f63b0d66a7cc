"""Sites, cubic energy and law of a duct's wall: computed once, then found in the cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.fem.nonlinear import CorotationalShell
from trocar.services.mechanics.fem.nonlinear.cubic_energy import cubic_tensor_and_energies
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.cache import fetch_record
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.softening.load_sites import LoadSites, Lumen, place_sites, scaled_to_cubic
from trocar.services.mechanics.reduction.softening.node_energy import fields_of, interpolated_j, known_nodes
from trocar.services.mechanics.reduction.softening.remainder import Remainder, no_remainder, remainder_of
from trocar.services.mechanics.reduction.softening.softening_law import (
    LOCAL_SCALE,
    LOCAL_SCALE_OF_NODES,
    Sample,
    TwoLaws,
    alike,
    fit_law,
    over_same_rho,
    place_of,
    share_of_nodes,
)
from trocar.services.mechanics.reduction.softening.training_mesh import has_few_nodes, training_recipe
from trocar.services.mechanics.reduction.softening.training_squeezes import SqueezedState, draw_squeezes, follow

BESIDE_WIDTHS = 0.5
"""Of the lumen: nodes so near a support are squeezed more often than others."""
LOCAL_WORK_SHARE = 1e-3
"""Of the work that is local deformation: below it a state says nothing about the law."""


@dataclass(frozen=True, slots=True)
class WallSoftening:
    """The trained softening of a wall.

    Attributes:
        third: (m, m, m) float32. T: third derivatives of the strain energy along the linear responses to unit forces on
            the sites.
        remainder: Remainder. Not known of a wall of many nodes.
    """

    sites: LoadSites
    third: Float32Array
    remainder: Remainder
    laws: TwoLaws


def fetch_softening(
    recipe: DuctRecipe,
    duct: ReducedDuct,
    n_squeezes: int,
    cache_dir: Path | None = None,
    progress: Progress = ignore_progress,
) -> WallSoftening:
    """Return the softening of a recipe's wall, from the cache where it is there.

    Raises ValueError if the wall encloses no lumen, or its supports hold some axes only.
    """

    def make() -> WallSoftening:
        return train_softening(recipe, own_compliance_m_n(duct), n_squeezes, progress)

    name = entry_name("softening", __name__, duct.basis.content_hash, recipe.key(), n_squeezes)
    return fetch_record(cache_dir, name, WallSoftening, make, recipe=recipe.key(), n_squeezes=n_squeezes)


def train_softening(
    recipe: DuctRecipe, own_m_n: FloatArray, n_squeezes: int, progress: Progress = ignore_progress
) -> WallSoftening:
    """Place sites, differentiate the energy, follow squeezes of the nonlinear reference, and fit the law to them.

    ``own_m_n`` (n, 3, 3) is the displacement of each node under unit forces on it.
    """
    progress("cubic energy", 0.0)
    lumen = Lumen.of(recipe.mesh)
    inward_m_n = np.einsum("na,nab,nb->n", lumen.inward, own_m_n, lumen.inward)
    wall = _Wall.of(recipe, lumen, inward_m_n, has_few_nodes(recipe))
    squeezed = training_recipe(recipe)
    followed = wall if squeezed is recipe else _Wall.of(squeezed, Lumen.of(squeezed.mesh))
    states: list[SqueezedState] = []
    drawn = draw_squeezes(squeezed, followed.lumen, followed.sites.nodes, n_squeezes, beside=followed.beside_supports())
    for done, squeeze in enumerate(drawn):
        progress("squeezes of the wall", done / n_squeezes)
        states += follow(squeezed, followed.lumen, squeeze)
    progress("squeezes of the wall", 1.0)
    return WallSoftening(wall.sites, wall.third, wall.remainder, _fit_laws(wall, followed, states))


def _fit_laws(wall: _Wall, followed: _Wall, states: list[SqueezedState]) -> TwoLaws:
    """Fit either law to all that was followed, beside supports or not: what they share is not what they learn from."""
    of_sites = fit_law(_samples(followed, states, energies_of_sites_j), followed.alike(followed), wall.alike(followed))
    if not wall.knows_nodes:
        return TwoLaws(of_sites, replace(of_sites, coefficients=of_sites.coefficients[:0]), np.zeros(0))
    among, to = (each.alike(followed, LOCAL_SCALE_OF_NODES) for each in (followed, wall))
    of_nodes = fit_law(_samples(followed, states, energies_of_nodes_j), among, to)
    return TwoLaws(*over_same_rho(of_sites, of_nodes), share_of_nodes(wall.from_support()))


@dataclass(frozen=True, slots=True)
class _Wall:
    """A wall with its sites and cubic energy."""

    model: ShellModel
    lumen: Lumen
    sites: LoadSites
    third: Float32Array
    remainder: Remainder

    @classmethod
    def of(
        cls, recipe: DuctRecipe, lumen: Lumen, inward_m_n: FloatArray | None = None, knows_nodes: bool = False
    ) -> _Wall:
        """Differentiate the energy; ``inward_m_n`` (n,) is what each node gives way inward, if it is known.

        ``knows_nodes``: what sites leave out is made as well. A law learned with that on few nodes is wrong on many.
        """
        model = recipe.model()
        own_m_n = _inward_m_n(model, lumen) if inward_m_n is None else inward_m_n
        sites, fields = place_sites(model, lumen, own_m_n)
        known = known_nodes(recipe.mesh, own_m_n)
        alone = fields_of(model, known, lumen.inward[known])
        shell = CorotationalShell(model)
        third, energy_j = cubic_tensor_and_energies(shell, fields, alone)
        own_j = interpolated_j(recipe.mesh, own_m_n, known, energy_j)
        remainder = remainder_of(shell, lumen, sites, fields) if knows_nodes else no_remainder()
        return cls(model, lumen, scaled_to_cubic(sites, third, lumen.inward, own_j), third, remainder)

    @property
    def knows_nodes(self) -> bool:
        return len(self.remainder.third) > 0

    def alike(self, other: _Wall, local_scale: float = LOCAL_SCALE) -> FloatArray:
        """(n, s) how alike the law is at its nodes and at another's, see `softening_law.alike`."""
        distance = cdist(self.model.mesh.vertices_m, other.model.mesh.vertices_m) / np.median(self.lumen.width_m)
        return alike(distance, self.from_support(), other.from_support(), local_scale)

    def beside_supports(self) -> IntArray:
        """Nodes of sites within half a lumen's width of a support, where the law varies most."""
        return self.sites.nodes[self.from_support()[self.sites.nodes] < BESIDE_WIDTHS]

    def from_support(self) -> FloatArray:
        """(n,) from each node to the nearest support, in widths of the lumen."""
        x = self.model.mesh.vertices_m
        held = np.unique(self.model.held_dofs // 6)
        far: FloatArray = np.asarray(cKDTree(x[held]).query(x)[0])
        return far / np.median(self.lumen.width_m)


def _inward_m_n(model: ShellModel, lumen: Lumen) -> FloatArray:
    """(n,) inward displacement of each node under a unit inward force on it."""
    loads = np.zeros((model.mesh.n_vertices, model.mesh.n_vertices, 3))
    loads[np.diag_indices(model.mesh.n_vertices)] = lumen.inward
    moved = model.factor.solve(np.stack([free_load(model, load) for load in loads], axis=1))
    own: FloatArray = np.einsum("nan,na->n", nodal_translations(model, moved), lumen.inward)
    return own


def own_compliance_m_n(duct: ReducedDuct) -> FloatArray:
    """(n, 3, 3) displacement of each node under unit forces on it, at rest."""
    basis, moved = duct.basis, np.zeros((3, duct.basis.n_nodes, 1, 3))
    for axis, force in enumerate(np.eye(3)):
        for node in range(basis.n_nodes):
            at = np.array([node], np.int32)
            duct.residual.apply(at, force[None], at, moved[axis, node])
    scaled = basis.Phi / basis.omega_rad_s
    compliance: FloatArray = moved[:, :, 0].transpose(1, 2, 0) + np.einsum("nar,nbr->nab", scaled, scaled)
    return compliance


Energies = Callable[["_Wall | WallSoftening", IntArray, FloatArray], tuple[float, float]]


def energies_of_sites_j(wall: _Wall | WallSoftening, nodes: IntArray, force_n: FloatArray) -> tuple[float, float]:
    """V and E of forces (k, 3) on nodes, spread over the sites and scaled; see `softening_law`."""
    at_sites = wall.sites.spread(nodes, force_n)
    return 0.5 * float(at_sites @ wall.sites.local_m_n @ at_sites), _cubic(wall.third, at_sites)


def energies_of_nodes_j(wall: _Wall | WallSoftening, nodes: IntArray, force_n: FloatArray) -> tuple[float, float]:
    """V and E that forces (k, 3) on nodes have themselves."""
    at_sites = wall.sites.spread(nodes, force_n / wall.sites.scale[nodes, None])
    V, more_j = wall.remainder.energies_j(at_sites, nodes, force_n)
    return V, _cubic(wall.third, at_sites) + more_j


def _samples(wall: _Wall, states: list[SqueezedState], energies_j: Energies) -> list[Sample]:
    samples = []
    for state in states:
        V, E = energies_j(wall, state.nodes, state.force_n)
        if V / state.work_j < LOCAL_WORK_SHARE:
            continue
        linear = _linear_work_j(wall.model, state.nodes, state.force_n)
        place = place_of(wall.model.mesh.n_vertices, state.nodes, state.force_n)
        samples.append(Sample(-E / V, (state.work_j - linear) / V, V / state.work_j, place))
    return samples


def _linear_work_j(model: ShellModel, nodes: IntArray, force_n: FloatArray) -> float:
    load = np.zeros((model.mesh.n_vertices, 3))
    np.add.at(load, nodes, force_n)
    moved = nodal_translations(model, model.factor.solve(free_load(model, load)))
    return float(np.sum(load * moved))


def _cubic(third: Float32Array, at_sites: FloatArray) -> float:
    """Return T a a a / 6 of the sites that are loaded: a few of some hundred, whose cubes are all to be read."""
    loaded = np.flatnonzero(at_sites)
    force, own = at_sites[loaded], third[np.ix_(loaded, loaded, loaded)]
    return float(force @ ((own @ force) @ force)) / 6.0
