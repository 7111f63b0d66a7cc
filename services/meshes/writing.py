"""Results on meshes as VTU files, which ParaView opens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from services.mechanics.arrays import FloatArray
from services.mechanics.surface.mesh import TriangleMesh


def write_vtu(
    path: Path,
    mesh: TriangleMesh,
    vertex_fields: Mapping[str, FloatArray],
    triangle_fields: Mapping[str, FloatArray] | None = None,
) -> None:
    """Write a mesh with fields on vertices, (n,) or (n, 3), and on triangles, (m,) or (m, 3); SI units."""
    import meshio

    cell_data = {name: [values] for name, values in (triangle_fields or {}).items()}
    grid = meshio.Mesh(
        mesh.vertices_m, [("triangle", mesh.triangles)], point_data=dict(vertex_fields), cell_data=cell_data
    )
    meshio.write(path, grid, file_format="vtu")
