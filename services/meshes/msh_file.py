"""The surface in a file of Gmsh; its physical groups are sets."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trocar.services.meshes.cells import Cells, surface_of
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.msh_rows import judge_rows
from trocar.services.meshes.surface_data import SurfaceData

_TAIL_BYTES = 1 << 12
_TAG = re.compile(rb"^\$(\w+)\s*$", re.MULTILINE)
_FORMAT = re.compile(rb"^\$MeshFormat\s+([\d.]+)\s+([01])\s+(\d+)", re.MULTILINE)
VERSIONS = ("2.0", "2.1", "2.2", "4.0", "4.1")


def read_msh(path: Path) -> SurfaceData:
    """Return the faces of a mesh, text or binary, and its physical groups by their names, or numbers as ``group 3``.

    Raises MeshError if the file is cut off, of another version, holds no faces, or meshio does not understand it.
    """
    import meshio

    _judge(path)
    try:
        mesh = meshio.gmsh.read(str(path))
    except Exception as error:  # it raises whatever a broken file trips it over
        said = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise MeshError(f"{path}: not a readable file of Gmsh ({said})") from error
    physical = mesh.cell_data.get("gmsh:physical")
    names = {(int(tag), int(dimension)): name for name, (tag, dimension) in mesh.field_data.items()}

    def blocks() -> Iterator[Cells]:
        for k, block in enumerate(mesh.cells):
            nodes = np.asarray(block.data, np.int64)
            members = {}
            if physical is not None:
                tags = np.asarray(physical[k], np.int64)
                for tag in np.unique(tags[tags > 0]).tolist():
                    name = names.get((tag, block.dim), f"group {tag}")
                    members[name] = np.flatnonzero(tags == tag)
            for name, chosen in mesh.cell_sets.items():
                if not name.startswith("gmsh:") and chosen[k] is not None and len(chosen[k]):
                    members[name] = np.asarray(chosen[k], np.int64)
            yield Cells(block.type, nodes.reshape(len(nodes), -1), members=members)

    points = np.asarray(mesh.points, np.float64).reshape(-1, 3)
    return surface_of(path, points, blocks(), {})


def _judge(path: Path) -> None:
    """Refuse a file that does not end as it must, is of another version, or holds other rows than it says."""
    with path.open("rb") as file:
        said = _FORMAT.search(file.read(_TAIL_BYTES))
        if said is None:
            raise MeshError(f"{path}: does not say its version after '$MeshFormat'")
        file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
        tags = _TAG.findall(file.read())
    version = said[1].decode()
    if (version if "." in version else f"{version}.0") not in VERSIONS:
        raise MeshError(f"{path}: is of Gmsh's version {version}, readable: {', '.join(VERSIONS)}")
    if not tags or not tags[-1].startswith(b"End"):
        last = f", its last section is '${tags[-1].decode()}'" if tags else ""
        raise MeshError(f"{path}: the file is cut off, it does not end with a '$End' of a section{last}")
    if said[2] == b"0":
        judge_rows(path, version if "." in version else f"{version}.0", path.read_bytes())
