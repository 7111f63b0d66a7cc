"""The reduced duct that every process holds: read-only, a function of modal coordinates and contact loads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.large_rotations.warping import TubeWarp
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.residual.blocks import Residual
from trocar.services.mechanics.reduction.residual.cached_rows import CachedRows
from trocar.services.mechanics.reduction.residual.patch_error import PatchError
from trocar.services.mechanics.surface.mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class ReducedDuct:
    """Mesh, modes, residual compliance and damping of one duct.

    Attributes:
        mesh: TriangleMesh. The undeformed mid-surface.
        basis: ModalBasis. r modes.
        residual: Residual. Static response of the modes left out.
        damping_ratio: (r,) float64. Fraction of critical damping of each mode.
        recipe: DuctRecipe, optional. What the modes were computed from.
        cache_dir: Path, optional. Where modes and residual are kept, and what else is computed of the duct: the user's
            cache by default.
        warp: TubeWarp, optional. Turns the cross-sections where large rotations are wanted. Code that places points of
            the wall applies it; `displacements` stays linear.
        residual_error: PatchError, optional. How far the residual is from the whole of it; none where it is the whole.
        n_local_modes: int. How many of the modes, the last ones, are those beside supports (`local_modes`).
        rows: CachedRows, optional. One cache of the residual's rows for all walls of this duct, which then belong to
            one thread; none where each wall has its own.
    """

    mesh: TriangleMesh
    basis: ModalBasis
    residual: Residual
    damping_ratio: FloatArray
    recipe: DuctRecipe | None = None
    cache_dir: Path | None = None
    warp: TubeWarp | None = None
    residual_error: PatchError | None = None
    n_local_modes: int = 0
    rows: CachedRows | None = None

    def __post_init__(self) -> None:
        if self.basis.n_nodes != self.mesh.n_vertices:
            raise ValueError(f"the basis has {self.basis.n_nodes} nodes and the mesh {self.mesh.n_vertices} vertices")
        if self.damping_ratio.shape != (self.basis.n_modes,):
            raise ValueError(f"{self.damping_ratio.size} damping ratios do not fit {self.basis.n_modes} modes")

    def displacements(self, q: FloatArray, load_nodes: IntArray, load_forces_n: FloatArray) -> FloatArray:
        """Return the displacement of every node (n, 3) in m: for the viewer, not for the 1 kHz step.

        ``q`` are the coordinates of all modes, or of the first ones.
        """
        field = self.basis.displacements(np.pad(q, (0, self.basis.n_modes - len(q))))
        every_node = np.arange(self.basis.n_nodes, dtype=np.int32)
        self.residual.apply(load_nodes, load_forces_n, every_node, field)
        return field
