"""The residual compliance of a duct with cyclic symmetry: the rows of one sector are those of all others, turned.

A straight duct of n_a by n_l cells is n_a / 2 copies of two rows of nodes along it. Between its nodes there are
n^2 blocks, but in frames that turn with the sectors only 2 n^2 / n_a of them differ: 26 MB in the place of 940 for
72 x 70 cells, and as many columns fewer to solve for.

Modes come in pairs, one the other turned, but for those that are symmetric themselves. A basis may end between two of a
pair: its residual is that of the pairs less what the odd one does, of rank one.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.build import BATCH, Progress, ignore_progress, residual_response
from trocar.services.mechanics.surface.cyclic_symmetry import CyclicSymmetry, turned_about_x

_WHOLE = 1e-4
"""A mode that leaves the span of all by more of itself than this when it is turned misses its partner."""
_ALIKE = 1e-6
"""Rows of two sectors, of the largest: solved one by one they differ by some 1e-9."""


def build_cyclic(
    model: ShellModel, basis: ModalBasis, symmetry: CyclicSymmetry, progress: Progress = ignore_progress
) -> tuple[FloatArray, FloatArray]:
    """Return the blocks and the odd modes of `Residual.cyclic`.

    Raises RuntimeError if the wall is not as symmetric as its mesh.
    """
    odd = odd_modes(model, basis, symmetry)
    pairs = ModalBasis.from_modes(basis.omega_rad_s[~odd], basis.Phi[:, :, ~odd])
    m, first = symmetry.n_sectors, symmetry.first
    rows = np.empty((len(first), len(first), m, 3, 3))
    for start in range(0, len(first), BATCH):
        nodes = first[start : start + BATCH]
        response = residual_response(model, pairs, nodes, np.arange(len(nodes), dtype=np.int32))
        # Transposed, each block is that of the loaded node of the first sector and of the moved one.
        own = _into_sectors(response.transpose(0, 1, 3, 2), symmetry)
        rows[start : start + BATCH, symmetry.seat, symmetry.sector] = own.transpose(1, 0, 2, 3)
        progress("residual compliance", (start + len(nodes)) / len(first))
    _check(model, pairs, symmetry, rows)
    mirrored = rows.transpose(1, 0, 2, 4, 3)[:, :, -np.arange(m) % m]
    flexible = basis.Phi[:, :, odd] / basis.omega_rad_s[odd]
    return 0.5 * (rows + mirrored), _into_sectors(flexible.transpose(0, 2, 1), symmetry).transpose(0, 2, 1)


def odd_modes(model: ShellModel, basis: ModalBasis, symmetry: CyclicSymmetry) -> BoolArray:
    """Return which modes (r,) miss their partner: turned by a sector they are no sum of the basis."""
    place = np.empty((len(symmetry.first), symmetry.n_sectors), np.int64)
    place[symmetry.seat, symmetry.sector] = np.arange(basis.n_nodes)
    image = place[symmetry.seat, (symmetry.sector + 1) % symmetry.n_sectors]
    turned = np.empty_like(basis.Phi)
    turned[image] = turned_about_x(basis.Phi.transpose(0, 2, 1), 2.0 * np.pi / symmetry.n_sectors).transpose(0, 2, 1)
    kept = np.einsum("nir,n,nis->rs", basis.Phi, model.mass_kg, turned, optimize=True)
    odd: BoolArray = np.sum(kept**2, axis=0) < 1.0 - _WHOLE
    return odd


def _into_sectors(vectors: FloatArray, symmetry: CyclicSymmetry) -> FloatArray:
    """Return vectors (n, ..., 3) of nodes in the frames of the nodes' sectors."""
    out = np.empty(vectors.shape)
    for number in range(symmetry.n_sectors):
        here = symmetry.sector == number
        out[here] = turned_about_x(vectors[here], -2.0 * np.pi * number / symmetry.n_sectors)
    return out


def _check(model: ShellModel, pairs: ModalBasis, symmetry: CyclicSymmetry, rows: FloatArray) -> None:
    """Solve for a node of another sector, too."""
    node = int(np.flatnonzero((symmetry.sector == 1) & (symmetry.seat == len(symmetry.first) // 2))[0])
    response = residual_response(model, pairs, np.array([node], np.int32), np.zeros(1, np.int32))[:, 0]
    own = _into_sectors(response.transpose(0, 2, 1), symmetry)
    own = turned_about_x(own.transpose(0, 2, 1), -2.0 * np.pi / symmetry.n_sectors).transpose(0, 2, 1)
    alike = rows[symmetry.seat[node], symmetry.seat, (symmetry.sector - 1) % symmetry.n_sectors]
    worst = np.abs(own - alike).max()
    if worst > _ALIKE * np.abs(rows).max():
        raise RuntimeError(f"the wall is not as symmetric as its mesh: rows of two sectors differ by {worst:.1e} m/N")
