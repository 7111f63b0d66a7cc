"""The reduced duct of a recipe: computed, or found in the cache."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction import cache
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.build import Progress, build_basis, fill_full_residual, ignore_progress
from trocar.services.mechanics.reduction.content_hash import entry_name
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.residual.blocks import Residual
from trocar.services.mechanics.reduction.residual.cyclic_residual import build_cyclic
from trocar.services.mechanics.reduction.residual.patch_error import PatchError, measure_patches
from trocar.services.mechanics.reduction.residual.patches import build_patches, largest_radius_m
from trocar.services.mechanics.reduction.residual_vectors import whole_pairs
from trocar.services.mechanics.surface.cyclic_symmetry import CyclicSymmetry, find_cyclic_symmetry

ADDED_DAMPING_RATIO = 1.0
"""At least, of residual vectors: a step does not resolve them, and what they take the place of had no mass."""


def reduce_duct(
    recipe: DuctRecipe,
    damping_ratio: float | FloatArray,
    cache_dir: Path | None = None,
    progress: Progress = ignore_progress,
) -> ReducedDuct:
    """Return the reduced duct of a recipe, from the cache where it is there.

    Args:
        recipe: DuctRecipe. What to reduce.
        damping_ratio: float or (r,) float64. Fraction of critical damping, the same or per mode; not part of what is
            cached.
        cache_dir: Path, optional. Where entries are kept; `cache_directory` by default.
        progress: callable. Called as ``progress(stage, fraction)`` while something is computed.
    """
    folder = cache_dir or cache_directory()
    maker = _Maker(recipe, progress)
    entry = cache.fetch(folder, entry_name("basis", __name__, recipe.key()), maker.make_basis)
    basis = ModalBasis.from_modes(entry.load("omega"), entry.load("phi"))
    residual, error = _fetch_residual(folder, maker, basis)
    ratio = np.broadcast_to(np.asarray(damping_ratio, np.float64), (basis.n_modes,)).copy()
    n_local = entry.facts.get("n_local_modes", 0)
    added = slice(basis.n_modes - n_local - entry.facts.get("n_stretch_modes", 0), None)
    ratio[added] = np.maximum(ratio[added], ADDED_DAMPING_RATIO)
    return ReducedDuct(recipe.mesh, basis, residual, ratio, recipe, folder, residual_error=error, n_local_modes=n_local)


def fetch_residual_displacement(
    recipe: DuctRecipe,
    duct: ReducedDuct,
    load_n: FloatArray,
    cache_dir: Path | None = None,
    progress: Progress = ignore_progress,
) -> FloatArray:
    """Return R f (n, 3) in m for a load (n, 3) on every node, from the cache where it is there.

    R between all nodes exists only as patches on large meshes, so this is the full static solution less the modes'
    part: exact, and worth keeping because it takes a factorisation of the full model.
    """
    basis = duct.basis

    def solve(entry: cache.Entry) -> None:
        progress("rest shape", 0.0)
        full = recipe.model().solve_static(load_n).displacement_m
        q = np.einsum("nar,na->r", basis.Phi, load_n) / basis.omega_rad_s**2
        entry.save("displacement", full - basis.displacements(q))
        entry.describe(content_hash=basis.content_hash, kind="residual displacement")
        progress("rest shape", 1.0)

    folder = cache_dir or cache_directory()
    name = entry_name("rest", __name__, basis.content_hash, recipe.key(), load_n)
    return cache.fetch(folder, name, solve).load("displacement")


def _fetch_residual(folder: Path, maker: _Maker, basis: ModalBasis) -> tuple[Residual, PatchError | None]:
    choice, symmetry = maker.recipe.residual, find_cyclic_symmetry(maker.recipe.mesh)
    kind = choice.resolved_kind(basis.n_nodes, symmetry.n_sectors if symmetry else 1)
    if kind == "none":
        return Residual.none(basis.n_nodes), None
    if kind == "full":
        name = entry_name("residual", __name__, basis.content_hash, kind)
        entry = cache.fetch(folder, name, partial(maker.make_full_residual, basis))
        return Residual.full(entry.share("blocks")), None
    if kind == "cyclic":
        if symmetry is None:
            raise ValueError("residual: cyclic needs a mesh whose parts are copies of each other, turned about x")
        name = entry_name("residual", __name__, basis.content_hash, kind)
        entry = cache.fetch(folder, name, partial(maker.make_cyclic, basis, symmetry))
        return Residual.cyclic(symmetry, entry.share("blocks"), entry.load("odd")), None
    size = choice.patch_radius_m or choice.budget_bytes
    name = entry_name("residual", __name__, basis.content_hash, kind, size)
    entry = cache.fetch(folder, name, partial(maker.make_patches, basis))
    patches = Residual.patches(entry.load("starts"), entry.load("neighbours"), entry.share("blocks"))
    return patches, PatchError(entry.facts["error_kept"], entry.facts["error_dropped"])


class _Maker:
    """Fills the entries of one recipe; the full model is assembled once and only if something is missing."""

    def __init__(self, recipe: DuctRecipe, progress: Progress) -> None:
        self.recipe = recipe
        self._progress = progress

    def make_basis(self, entry: cache.Entry) -> None:
        recipe, n_stretch, n_local = self.recipe, 0, 0
        # One mode more, of which whole pairs are taken: a sector's residual is then that of all.
        added = bool(recipe.n_local_modes or recipe.stretch_law)
        basis = build_basis(self._model, recipe.n_modes + int(added), self._progress)
        if added:
            basis = whole_pairs(basis)
            if recipe.stretch_law is not None:
                # Imported where a wall has one, as those below.
                from trocar.services.mechanics.reduction.hyperelastic.stretched_states import with_stretch_modes

                basis, n_stretch = with_stretch_modes(self._model, basis, recipe.stretch_law)
            if recipe.n_local_modes:
                # Imported where a wall has them: scipy's trees are a good part of what a process imports.
                from trocar.services.mechanics.reduction.local_modes import with_local_modes

                basis, n_local = with_local_modes(self._model, basis, recipe.n_local_modes)
        entry.save("omega", basis.omega_rad_s)
        entry.save("phi", basis.Phi)
        facts = {"n_nodes": basis.n_nodes, "n_local_modes": n_local, "n_stretch_modes": n_stretch}
        entry.describe(content_hash=basis.content_hash, n_modes=basis.n_modes, **facts)

    def make_full_residual(self, basis: ModalBasis, entry: cache.Entry) -> None:
        blocks = entry.create("blocks", (basis.n_nodes, basis.n_nodes, 3, 3), np.float32)
        fill_full_residual(self._model, basis, blocks, self._progress)
        entry.describe(content_hash=basis.content_hash, kind="full")

    def make_cyclic(self, basis: ModalBasis, symmetry: CyclicSymmetry, entry: cache.Entry) -> None:
        blocks, odd = build_cyclic(self._model, basis, symmetry, self._progress)
        entry.save("blocks", blocks.astype(np.float32))
        entry.save("odd", odd)
        entry.describe(content_hash=basis.content_hash, kind="cyclic")

    def make_patches(self, basis: ModalBasis, entry: cache.Entry) -> None:
        choice = self.recipe.residual
        radius_m = choice.patch_radius_m or largest_radius_m(self.recipe.mesh.vertices_m, choice.budget_bytes)
        residual = build_patches(self._model, basis, radius_m, progress=self._progress)
        entry.save("starts", residual.store.starts)
        entry.save("neighbours", residual.store.neighbours)
        entry.save("blocks", residual.blocks)
        error = measure_patches(self._model, basis, residual)
        facts = {"radius_m": radius_m, "error_kept": error.kept, "error_dropped": error.dropped}
        entry.describe(content_hash=basis.content_hash, kind="patches", **facts)

    @cached_property
    def _model(self) -> ShellModel:
        self._progress("assembly", 0.0)
        model = self.recipe.model()
        self._progress("assembly", 1.0)
        return model
