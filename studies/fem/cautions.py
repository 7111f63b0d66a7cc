"""What to keep in mind when reading the numbers of a ``trocar fem`` case."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import IntArray
from trocar.services.mechanics.fem import ShellModel, StaticSolution
from trocar.services.mechanics.fem.elements import MEMBRANE_ELEMENTS
from trocar.services.mechanics.fem.nonlinear import Configuration, PathPoint
from trocar.services.mechanics.fem.thinness import thickness_over_width
from trocar.services.mechanics.surface.mesh import unique_edges
from trocar.studies.fem.case import FemCase
from trocar.studies.fem.facets import drilling_excess, rim_eccentricity
from trocar.studies.fem.select import select

THINNEST_RATIO = 2e-4
"""A fifth of what the thinnest walls compared with theory have; millimetres read as metres lie below."""
DOUBTFUL_RATIO = 0.2
"""Thickness over width beyond which the transverse shear that a Kirchhoff shell lacks is no longer small."""
LARGE_DISPLACEMENT = 0.1
"""Part of the mesh's size beyond which a linear solution is no picture of what happens."""
LARGE_STRAIN = 0.1
"""Of the wall's middle surface, beyond which elements that are linear in strain say little."""
DOUBTFUL_EXCESS = 0.01
"""Part by which torsion may be too stiff without a word."""
EDGE_LAYERS = 3.0
"""Cell at a clamped edge over the width of the layer in which a stretched wall is bent there: that decays as
exp(-x / width), so that of a cell of three widths one end has all of it and the other a twentieth."""
DOUBTFUL_BESIDE = 0.05
"""Of the thickness, by which forces on a rim may act beside the wall: they bend it by six times that of the stress."""


def find_cautions(case: FemCase, model: ShellModel, static: StaticSolution | None, path: list[PathPoint]) -> list[str]:
    """Return what to keep in mind when reading a case's numbers, a sentence each."""
    cautions = []
    ratio, centre_m = thickness_over_width(model.mesh, model.section)
    if ratio > DOUBTFUL_RATIO:
        place_mm = np.round(1e3 * centre_m, 2).tolist()
        cautions.append(
            f"the wall's thickness is {ratio:.2g} of the width of the piece round {place_mm} mm: transverse shear, "
            "which a Kirchhoff shell lacks, counts there"
        )
    if ratio < THINNEST_RATIO:
        cautions.append(
            f"the wall's thickness is {ratio:.2g} of the width of every piece: is the mesh, or thickness_m, in "
            f"another unit? {THINNEST_RATIO:g} is the thinnest that makes sense here"
        )
    excess = drilling_excess(model.mesh, model.section)
    name = model.elements.membrane
    if MEMBRANE_ELEMENTS[name].has_stiff_drilling and excess > DOUBTFUL_EXCESS:
        cautions.append(
            f"elements.membrane: '{name}' makes torsion of this wall about {100 * excess:.2g} % too stiff, its cells "
            "are short beside the angle between them; 'cst' or longer cells do not"
        )
    beside = rim_eccentricity(model.mesh, model.section, _bent_rim(case, model))
    if MEMBRANE_ELEMENTS[name].has_stiff_drilling and beside > DOUBTFUL_BESIDE:
        cautions.append(
            f"elements.membrane: '{name}' takes forces on the vertices of a curved rim as if they acted "
            f"{beside:.2g} of the thickness beside the wall, which bends it there; 'cst', shorter edges, or supports "
            "that hold rotations too, do not"
        )
    size_m = float(np.linalg.norm(np.ptp(model.mesh.vertices_m, axis=0)))
    moved_m = 0.0 if static is None else float(np.linalg.norm(static.displacement_m, axis=1).max())
    if moved_m > LARGE_DISPLACEMENT * size_m:
        cautions.append(
            f"the largest displacement is {moved_m / size_m:.2g} of the mesh's size: displacements are taken as small, "
            "so only its proportion to the load means something (analysis: nonlinear follows it)"
        )
    strain = _largest_strain(model, path[-1].at) if path else 0.0
    cell_m, layer_m = _clamped_cell_m(model), _edge_layer_m(model, strain)
    if cell_m > EDGE_LAYERS * layer_m:
        cautions.append(
            f"the stretched wall bends over {1e3 * layer_m:.2g} mm where its edge is clamped, and cells there are "
            f"{1e3 * cell_m:.2g} mm wide: results are some per cent too stiff; smaller cells at that edge are not"
        )
    if strain > LARGE_STRAIN:
        cautions.append(f"the largest strain of the wall's middle is {strain:.2g}: rotations may be large, strains not")
    return cautions


def _bent_rim(case: FemCase, model: ShellModel) -> IntArray:
    """Vertices on which forces act, or reactions of supports, and which may turn."""
    held = np.zeros((model.mesh.n_vertices, 6), bool)
    held.ravel()[model.held_dofs] = True
    is_acted = np.asarray(held[:, :3].any(axis=1))
    for part in case.loads:
        if part.force_n and part.where is not None:
            is_acted[select(model.mesh, part.where, "loads")] = True
    return np.flatnonzero(is_acted & ~held[:, 3:].all(axis=1)).astype(np.int32)


def _largest_strain(model: ShellModel, at: Configuration) -> float:
    """Largest change of an edge's length over that length."""
    edges = unique_edges(model.mesh)[0]
    before, after = (
        np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1) for x in (model.mesh.vertices_m, at.position_m)
    )
    return float(np.abs(after / before - 1.0).max())


def _clamped_cell_m(model: ShellModel) -> float:
    """Return the median length of the edges from clamped vertices to others, zero where there are none."""
    held = np.zeros((model.mesh.n_vertices, 6), bool)
    held.ravel()[model.held_dofs] = True
    is_clamped, edges = np.asarray(held.all(axis=1)), unique_edges(model.mesh)[0]
    leaves = edges[is_clamped[edges[:, 0]] != is_clamped[edges[:, 1]]]
    if not len(leaves):
        return 0.0
    x = model.mesh.vertices_m
    return float(np.median(np.linalg.norm(x[leaves[:, 1]] - x[leaves[:, 0]], axis=1)))


def _edge_layer_m(model: ShellModel, strain: float) -> float:
    """Return sqrt(D / N), D the bending stiffness, N the tension of a wall that is stretched both ways by a strain."""
    thickness = float(np.mean(model.section.per_triangle("thickness_m", model.mesh.n_triangles)))
    nu = float(np.mean(model.section.per_triangle("poisson_ratio", model.mesh.n_triangles)))
    return thickness / float(np.sqrt(12.0 * (1.0 + nu) * strain)) if strain > 0.0 else np.inf
