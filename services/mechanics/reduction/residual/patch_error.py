"""Error of the residual compliance in patches, measured against exact columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.build import residual_response
from trocar.services.mechanics.reduction.residual.blocks import Residual

SAMPLES = 8
"""Nodes whose columns are solved: 24 solves."""
WORTH_SAYING = 1e-3


@dataclass(frozen=True, slots=True)
class PatchError:
    """Worst errors of a displacement, over what the same force does to the node that it acts on."""

    kept: float
    """Within the radius: what probing spills; zero where every column was solved."""
    dropped: float
    """Beyond the radius, where the residual counts as zero."""

    def sentence(self) -> str | None:
        """What a person should know, or None where it is not worth saying."""
        if max(self.kept, self.dropped) <= WORTH_SAYING:
            return None
        return (
            f"the duct's mesh is beyond the memory of its residual: under a load the wall is off by up to "
            f"{100 * self.kept:.2g} % of the loaded node's displacement near it and {100 * self.dropped:.2g} % far "
            "from it; larger triangles, or duct.residual: full with 36 bytes for each pair of nodes, have none of this"
        )


def measure_patches(model: ShellModel, basis: ModalBasis, residual: Residual) -> PatchError:
    """Compare the patches of some nodes, evenly spread over the numbering, with their exact columns."""
    compliant = np.flatnonzero(np.abs(basis.Phi).max(axis=(1, 2)) > 0.0)
    nodes = compliant[np.linspace(0, len(compliant) - 1, SAMPLES).astype(np.int32)].astype(np.int32)
    exact = residual_response(model, basis, nodes, np.arange(len(nodes), dtype=np.int32))
    kept = dropped = 0.0
    for column, node in enumerate(nodes):
        flexible = basis.Phi[node] / basis.omega_rad_s
        own = float(np.linalg.norm(exact[node, column] + flexible @ flexible.T, 2))
        here = slice(residual.store.starts[node], residual.store.starts[node + 1])
        inside = residual.store.neighbours[here]
        outside = np.setdiff1d(np.arange(basis.n_nodes), inside)
        off = residual.blocks[here].transpose(0, 2, 1) - exact[inside, column]
        kept = max(kept, float(np.linalg.norm(off, 2, axis=(1, 2)).max()) / own)
        far = np.linalg.norm(exact[outside, column], 2, axis=(1, 2))
        dropped = max(dropped, float(far.max(initial=0.0)) / own)
    return PatchError(kept, dropped)
