"""Whether a wall is thin enough to be a shell at all."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.section import ShellSection
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_components


def thickness_over_width(mesh: TriangleMesh, section: ShellSection) -> tuple[float, FloatArray]:
    """Largest ratio of thickness to width of all connected pieces, and the (3,) centre of that piece in m.

    Width is the middle one of a piece's three principal extents: a plate's shorter side, a tube's diameter.
    """
    thickness = section.per_triangle("thickness_m", mesh.n_triangles)
    pieces = vertex_components(mesh)
    thickest = np.zeros(int(pieces.max()) + 1)
    np.maximum.at(thickest, pieces[mesh.triangles[:, 0]], thickness)
    order = np.argsort(pieces, kind="stable")
    worst = (0.0, mesh.vertices_m[0])
    for piece, vertices in enumerate(np.split(order, np.flatnonzero(np.diff(pieces[order])) + 1)):
        centre = mesh.vertices_m[vertices].mean(axis=0)
        arms = mesh.vertices_m[vertices] - centre
        extents = np.ptp(arms @ np.linalg.eigh(arms.T @ arms)[1], axis=0)
        width = float(np.sort(extents)[1])
        ratio = float(thickest[piece]) / width if width > 0.0 else float("inf")
        worst = max(worst, (ratio, centre), key=lambda found: found[0])
    return worst


def check_thin(mesh: TriangleMesh, section: ShellSection) -> None:
    """Refuse a wall that is thicker than the piece it belongs to is wide.

    Raises ValueError that names the piece by its place, and both lengths.
    """
    ratio, centre = thickness_over_width(mesh, section)
    if ratio > 1.0:
        raise ValueError(
            f"section: thickness_m is {ratio:.3g} times the width of the piece round "
            f"{(np.round(1e3 * centre, 2) + 0.0).tolist()} mm, that is no shell: is one of them in another unit?"
        )
