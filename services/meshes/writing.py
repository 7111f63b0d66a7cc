"""Results on meshes as VTU files, which ParaView opens."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from trocar.services.files.atomic_file import atomic_file
from trocar.services.mechanics.arrays import ByteArray, FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh

_GRID = "<UnstructuredGrid>"


def write_vtu(
    path: Path,
    mesh: TriangleMesh,
    vertex_fields: Mapping[str, FloatArray],
    triangle_fields: Mapping[str, FloatArray] | None = None,
    constants: Mapping[str, float] | None = None,
) -> None:
    """Write a mesh with fields on vertices, (n,) or (n, 3), and on triangles, (m,) or (m, 3); SI units.

    The file is written whole or not at all. Vertex sets are arrays of 0 and 1 on vertices, which `read_surface` reads.
    Raises ValueError if a name is none that ParaView's calculator takes: letters, digits and underscores.

    Args:
        constants: Numbers of the whole mesh, as field data.
    """
    import meshio

    cell_data = {name: [values] for name, values in (triangle_fields or {}).items()}
    sets = {calculator_name(name): _members(mesh, ids) for name, ids in mesh.vertex_sets.items()}
    for name in (*vertex_fields, *cell_data, *(constants or {})):
        if name != calculator_name(name):
            raise ValueError(f"'{name}' is no name that ParaView's calculator takes")
    grid = meshio.Mesh(
        mesh.vertices_m, [("triangle", mesh.triangles)], point_data={**sets, **vertex_fields}, cell_data=cell_data
    )
    with atomic_file(path) as half:
        meshio.write(half, grid, file_format="vtu")
        if constants:
            text = half.read_text(encoding="utf-8")
            half.write_text(text.replace(_GRID, f"{_GRID}\n{_field_data(constants)}", 1), encoding="utf-8")


def calculator_name(name: str) -> str:
    """Return a name with an underscore for each character that ParaView's calculator does not take in a name."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return plain if plain[:1].isalpha() or plain.startswith("_") else f"_{plain}"


def _members(mesh: TriangleMesh, ids: IntArray) -> ByteArray:
    found = np.zeros(mesh.n_vertices, np.int8)
    found[ids] = 1
    return found


def _field_data(constants: Mapping[str, float]) -> str:
    arrays = "".join(
        f'<DataArray type="Float64" Name="{name}" NumberOfTuples="1" format="ascii">{value!r}</DataArray>\n'
        for name, value in constants.items()
    )
    return f"<FieldData>\n{arrays}</FieldData>"
