"""Ends of a closed tube, cut open square to its centreline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.anatomy.centring import Centreline
from trocar.services.anatomy.sections import Sectioner
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, unique_edges
from trocar.services.meshes.errors import MeshError

FULL_AREA = 0.95
"""Of the area one radius further in: less, and the section lies in a rounded or oblique end."""
_FIT_DIAMETERS = 1.75
"""Length of centreline from which the direction of a cut is taken."""
_LEAST_LENGTH = 1.5
"""Of a tube between its cuts, in its own diameters: shorter is a blob."""


@dataclass(frozen=True)
class Cut:
    """A plane that opens an end.

    Attributes:
        middle_m, outward: (3,) float64. Of the section, and the unit normal out of the tube.
        diameter_m: float. Of the circle with the section's area.
        tip_m: (3,) float64. The tip that is cut off.
        length_m: float. Of the centreline that is cut off with it, from its first section on.
    """

    middle_m: FloatArray
    outward: FloatArray
    diameter_m: float
    tip_m: FloatArray
    length_m: float


def find_cut(line: Centreline, tip_m: FloatArray, sectioner: Sectioner) -> Cut:
    """Return the plane nearest to the tip, at the line's first point, where the section is the tube's whole.

    Raises MeshError if there is none in the first half of the line.
    """
    at_m, diameters = line.at_m, line.diameters_m
    areas = diameters**2
    for k in range(len(at_m) // 2 + 1):
        inner = np.interp(at_m[k] + 0.5 * diameters[k] * np.array([1.0, 2.0]), at_m, areas)
        if areas[k] >= FULL_AREA * inner[0] and areas[k] >= 0.8 * inner[1]:
            outward = -_tangent(line, k, diameters[k])
            section = sectioner.cut(line.points_m[k], outward)
            if section is not None:
                return Cut(section.middle_m, outward, section.diameter_m, tip_m, float(at_m[k]))
    raise MeshError(
        f"the end at {_mm(tip_m)} mm has no whole section to be cut at: the duct is cut off lengthwise there"
    )


def _tangent(line: Centreline, k: int, reach_m: float) -> FloatArray:
    """Return the tangent at a point, of the parabola through the line further in."""
    at_m = line.at_m - line.at_m[k]
    within = np.flatnonzero((at_m >= 0.0) & (at_m <= max(_FIT_DIAMETERS * reach_m, 4.0 * (at_m[-1] / len(at_m)))))
    order = min(2, len(within) - 1)
    slopes = np.polyfit(at_m[within], line.points_m[within], order)[-2]
    unit: FloatArray = slopes / np.linalg.norm(slopes)
    return unit


def judge_tube(line: Centreline, first: Cut, last: Cut) -> None:
    """Refuse what is no tube between its two cuts.

    Raises MeshError that names length and width.
    """
    length_m = float(line.at_m[-1]) - first.length_m - last.length_m
    width_m = float(np.median(line.diameters_m))
    if length_m < _LEAST_LENGTH * width_m:
        raise MeshError(
            f"is no duct but a closed body without openings round {_mm(line.points_m.mean(axis=0))} mm: "
            f"{1e3 * max(length_m, 0.0):.2g} mm long between what can be cut open, and {1e3 * width_m:.2g} mm wide"
        )


def cut_open(mesh: TriangleMesh, cuts: list[Cut]) -> TriangleMesh:
    """Return the surface without what lies beyond the cuts, towards their tips.

    Raises MeshError if a cut would take another end with it.
    """
    import pyvista

    for cut in cuts:
        height = (mesh.vertices_m - cut.middle_m) @ cut.outward
        beyond = _beyond(mesh, height, cut)
        for other in cuts:
            if other is not cut and beyond[_nearest(mesh, other.middle_m - 0.5 * other.diameter_m * other.outward)]:
                raise MeshError(
                    f"the end at {_mm(cut.middle_m)} mm cannot be cut without that at {_mm(other.middle_m)} mm"
                )
        surface = pyvista.PolyData.from_regular_faces(mesh.vertices_m, mesh.triangles)
        surface["beyond_m"] = np.where(beyond, height, np.minimum(height, -1e-9))
        surface = surface.clip_scalar(scalars="beyond_m", invert=True, value=0.0)
        surface = surface.extract_surface(algorithm="dataset_surface").triangulate().clean()
        mesh = TriangleMesh(np.asarray(surface.points, np.float64), np.asarray(surface.regular_faces, np.int32))
    return mesh


def _beyond(mesh: TriangleMesh, height: FloatArray, cut: Cut) -> FloatArray:
    """Return the vertices (n,) beyond a plane that hang together with the tip there."""
    edges, _ = unique_edges(mesh)
    edges = edges[(height[edges] > 0.0).all(axis=1)]
    graph = scipy.sparse.coo_array((np.ones(len(edges), np.int8), edges.T), shape=(mesh.n_vertices,) * 2)
    _, piece = scipy.sparse.csgraph.connected_components(graph, directed=False)
    candidates = np.flatnonzero(height > 0.0)
    tip = candidates[np.argmin(np.linalg.norm(mesh.vertices_m[candidates] - cut.tip_m, axis=1))]
    beyond: FloatArray = (piece == piece[tip]) & (height > 0.0)
    return beyond


def _nearest(mesh: TriangleMesh, place_m: FloatArray) -> int:
    return int(np.argmin(np.linalg.norm(mesh.vertices_m - place_m, axis=1)))


def _mm(place_m: FloatArray) -> list[float]:
    place: list[float] = np.round(1e3 * place_m, 1).tolist()
    return place
