"""What a patch radius costs in error: the residual compliance cut at a radius against the full block.

    OPENBLAS_NUM_THREADS=1 python benchmarks/study_residual_patches.py

For every pair of nodes the error of their compliance is set against the geometric mean of their own compliances:
what one newton on one node wrongly does to the other, relative to what it does to itself.
"""

from __future__ import annotations

import math
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from report import Row, parse, write_report

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.reduction.build import build_basis, fill_full_residual
from trocar.services.mechanics.reduction.residual.patches import build_patches
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADII_M = (1.5e-3, 2e-3, 3e-3, 4e-3, 6e-3, 8e-3)
SHAPES = ((24, 36, 60), (24, 36, 100), (36, 54, 100))


def norms(blocks: np.ndarray) -> np.ndarray:
    return np.linalg.norm(blocks, axis=(2, 3))


def study(n_around: int, n_along: int, n_modes: int) -> list[Row]:
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, n_around, n_along))
    model = ShellModel(mesh, ShellSection(0.5e-3, 100e3, 0.45, 1060.0), [clamp(mesh)], ElementChoice("andes", "dkt"))
    basis, n = build_basis(model, n_modes), mesh.n_vertices
    full = np.zeros((n, n, 3, 3), np.float32)
    fill_full_residual(model, basis, full)
    flexible = np.ascontiguousarray((basis.Phi / basis.omega_rad_s).reshape(3 * n, -1))
    own = [flexible[3 * i : 3 * i + 3] @ flexible[3 * i : 3 * i + 3].T + full[i, i] for i in range(n)]
    own = np.linalg.norm(own, axis=(1, 2))
    # A node next to the clamp hardly moves at all: relative errors there say nothing.
    free = np.flatnonzero(own > 0.01 * own.max())
    scale = np.sqrt(np.outer(own[free], own[free]))
    label = f"{n} nodes, r = {n_modes}"
    bare = norms(full)[np.ix_(free, free)] / scale
    rows = [Row(f"{label}: no residual, worst on the loaded node", 100.0 * np.diag(bare).max(), "%")]
    for radius in RADII_M:
        rows += radius_rows(model, basis, full, free, scale, f"{label}, {1e3 * radius:g} mm", radius)
    return rows


def radius_rows(model, basis, full, free, scale, label, radius) -> list[Row]:
    rows = []
    for probing in (False, True):
        patches = build_patches(model, basis, radius, apart_m=2.0 * radius if probing else math.inf)
        cut = np.zeros_like(full)
        rows_of = np.repeat(np.arange(basis.n_nodes), np.diff(patches.store.starts))
        cut[rows_of, patches.store.neighbours] = patches.blocks
        error = 100.0 * norms(cut - full)[np.ix_(free, free)] / scale
        facts = [f"99 % of pairs below {np.percentile(error, 99):.1f} %"]
        if probing:
            facts.append(f"loaded node itself {np.diag(error).max():.1f} %")
        else:
            facts.append(f"{patches.store.neighbours.size / basis.n_nodes:.0f} blocks a node")
            facts.append(f"{1e-6 * patches.blocks.nbytes:.1f} MB")
        way = "probed" if probing else "exact columns"
        rows.append(Row(f"{label}, {way}: worst pair", error.max(), "%", note=", ".join(facts)))
    return rows


NOTES = """Reference duct (R 4 mm, L 40 mm, t 0.5 mm). With exact columns a loaded node and its patch are exact (to
float32), and the error is that of pairs farther apart than the radius. Probing shares solves between nodes two radii
apart, so the loaded node has an error too."""


def main() -> None:
    parse(__doc__)
    rows = [row for shape in SHAPES for row in study(*shape)]
    write_report("residual_patches", "Residual compliance in patches", rows, NOTES)


if __name__ == "__main__":
    main()
