"""Even triangles of a wanted size."""

from __future__ import annotations

import warnings

import numpy as np

from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2
from trocar.services.meshes.checking import check_surface
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import open_rims
from trocar.services.meshes.plausibility import judge_remeshing

FEWEST_VERTICES = 32
"""A tube with fewer vertices than these does not keep its ends."""
SAMPLES_PER_CLUSTER = 20
"""Vertices of the subdivided surface that one vertex of the new mesh gathers, at least."""
SHARES = (1.0, *(1.0 + sign * 0.01 * step for step in range(1, 6) for sign in (-1.0, 1.0)))
"""Of the wanted number of vertices, tried one after the other until the clusters touch nowhere.

Whether they touch hangs on the last bit of the surface: on a vessel with branches they do in a third of all tries.
"""


def remesh(mesh: TriangleMesh, edge_m: float) -> TriangleMesh:
    """Even triangles with edges of about ``edge_m``, by centroidal Voronoi clustering (pyacvd); deterministic.

    Where clusters touch, a few more or fewer of them are tried: up to 5 %, which is 2.5 % of an edge.

    A scan is clustered as fine as it is: two million triangles take some seconds. To collapse edges first would leave
    long triangles where a wall is straight, whose clusters touch.

    Open rims stay open but lose up to half an edge of length.
    Raises MeshError if the edge is too short for the surface: too many triangles; or too long: rims close, or sheets
    touch.
    """
    if not edge_m > 0.0:
        raise MeshError(f"edge_m must be positive, is {edge_m}")
    n_vertices = vertices_for_edge(mesh, edge_m)
    if n_vertices < FEWEST_VERTICES:
        raise MeshError(f"edges of {1e3 * edge_m:.3g} mm are too long for a surface this small")
    judge_remeshing(n_vertices, edge_m)
    growth = SAMPLES_PER_CLUSTER * n_vertices / mesh.n_vertices
    subdivisions = max(0, int(np.ceil(np.log(growth) / np.log(4.0))))
    wanted, refused = f"edges of {1e3 * edge_m:.3g} mm", list[MeshError]()
    for share in SHARES:
        try:
            return _accept(mesh, _cluster(mesh, round(share * n_vertices), subdivisions), wanted)
        except MeshError as error:
            refused.append(error)
    raise refused[0]


def _cluster(mesh: TriangleMesh, n_vertices: int, subdivisions: int) -> TriangleMesh:
    import pyacvd
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(mesh.vertices_m.copy(), mesh.triangles.copy())
    with warnings.catch_warnings():
        # pyacvd 0.4 reads a property that pyvista 0.48 renamed; nothing here can be done differently.
        warnings.simplefilter("ignore", pyvista.PyVistaDeprecationWarning)
        clustering = pyacvd.Clustering(surface)
        if subdivisions:
            clustering.subdivide(subdivisions)
        clustering.cluster(n_vertices)
        result = clustering.create_mesh()
    return TriangleMesh(result.points, result.regular_faces)


def vertices_for_edge(mesh: TriangleMesh, edge_m: float) -> int:
    """Vertices of an equilateral mesh of the same area with the wanted edge."""
    area_per_vertex = edge_m**2 * np.sqrt(3.0) / 2.0
    return round(float(triangle_areas_m2(mesh).sum() / area_per_vertex))


def _accept(before: TriangleMesh, after: TriangleMesh, wanted: str) -> TriangleMesh:
    findings = check_surface(after)
    if findings:
        raise MeshError(f"remeshing to {wanted} breaks the surface: " + "; ".join(map(str, findings)))
    rims = len(open_rims(before)), len(open_rims(after))
    if rims[0] != rims[1]:
        raise MeshError(f"remeshing to {wanted} turns {rims[0]} open ends into {rims[1]}")
    return after
