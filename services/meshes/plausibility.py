"""Whether a surface has a duct's size, and what remeshing it would take: judged before anything is allocated."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.fem.memory import check_memory, solve_bytes
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.units import METRES_PER_UNIT
from trocar.services.meshes.errors import MeshError

DUCT_LENGTH_M = (1e-3, 2.0)
"""Whatever is shorter or longer is in another unit than was said."""
MOST_TRIANGLES = 200_000
"""That a surface is remeshed into: as many take some minutes, and 0.5 GB before it is solved."""


def judge_unit(mesh: TriangleMesh, units: str) -> None:
    """Refuse a surface whose size in ``units`` is no duct's.

    Raises MeshError that names the size, and the units in which it would be one.
    """
    length_m = float(np.linalg.norm(np.ptp(mesh.vertices_m, axis=0)))
    low, high = DUCT_LENGTH_M
    if low <= length_m <= high:
        return
    others = {name: length_m * metres / METRES_PER_UNIT[units] for name, metres in METRES_PER_UNIT.items()}
    fitting = [
        f"in {name} it would be {1e3 * length:.3g} mm" for name, length in others.items() if low <= length <= high
    ]
    raise MeshError(
        f"with units '{units}' the surface is {length_m:.3g} m from corner to corner, a duct is {1e3 * low:g} mm to "
        f"{high:g} m{': ' + ', '.join(fitting) if fitting else ''}"
    )


def judge_size(mesh: TriangleMesh) -> None:
    """Refuse a surface that is to be solved as it stands and would not fit: its repair alone takes minutes.

    Raises MeshError that names the number of vertices, the memory they take and what is free.
    """
    try:
        check_memory(mesh.n_triangles // 2)
    except ValueError as error:
        raise MeshError(f"{error}, or give edge_m to remesh") from None


def judge_remeshing(n_vertices: int, edge_m: float) -> None:
    """Refuse an edge so short that the new mesh would be too large.

    Raises MeshError that names the edge, how many triangles it makes, and what they would take.
    """
    if 2 * n_vertices > MOST_TRIANGLES:
        raise MeshError(
            f"edges of {1e3 * edge_m:.3g} mm make about {2.0 * n_vertices:.2g} triangles of this surface, which take "
            f"{1e-9 * solve_bytes(n_vertices):.2g} GB to solve; at most {MOST_TRIANGLES} are made: give a longer edge_m"
        )
