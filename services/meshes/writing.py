"""Results on meshes as VTU files, which ParaView opens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from trocar.services.files.atomic_file import atomic_file
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh


def write_vtu(
    path: Path,
    mesh: TriangleMesh,
    vertex_fields: Mapping[str, FloatArray],
    triangle_fields: Mapping[str, FloatArray] | None = None,
) -> None:
    """Write a mesh with fields on vertices, (n,) or (n, 3), and on triangles, (m,) or (m, 3); SI units.

    The file is written whole or not at all.
    """
    import meshio

    cell_data = {name: [values] for name, values in (triangle_fields or {}).items()}
    grid = meshio.Mesh(
        mesh.vertices_m, [("triangle", mesh.triangles)], point_data=dict(vertex_fields), cell_data=cell_data
    )
    with atomic_file(path) as half:
        meshio.write(half, grid, file_format="vtu")
