"""What is run in another process: a surface file of any format, to arrays."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.file_kind import HEAD_BYTES, find_kind
from trocar.services.meshes.inp_file import read_inp
from trocar.services.meshes.msh_file import read_msh
from trocar.services.meshes.obj_file import read_obj
from trocar.services.meshes.ply_file import read_ply
from trocar.services.meshes.polygons import split_faces
from trocar.services.meshes.stl_file import read_binary_stl, read_text_stl
from trocar.services.meshes.surface_data import SurfaceData
from trocar.services.meshes.vtp_file import read_vtp
from trocar.services.meshes.vtu_file import read_vtu

_READERS: dict[str, Callable[[Path], SurfaceData]] = {
    "stl": read_binary_stl, "text stl": read_text_stl, "obj": read_obj, "ply": read_ply, "vtp": read_vtp,
    "vtu": read_vtu, "msh": read_msh, "inp": read_inp,
}  # fmt: skip


def read(path: str) -> Iterator[bytes]:
    """Yield what was done in reading and the names of sets (JSON), vertices (n, 3), triangles (m, 3), all sets (npy).

    Raises MeshError if the file cannot be read; the sentence names it.
    """
    data, triangles = _read(Path(path))
    yield json.dumps([data.actions, [[name, len(ids)] for name, ids in data.sets.items()]]).encode()
    yield _npy(data.vertices)
    yield _npy(triangles.astype(np.int32))
    yield _npy(np.concatenate([np.zeros(0, np.int32), *(ids.astype(np.int32) for ids in data.sets.values())]))


def _read(path: Path) -> tuple[SurfaceData, npt.NDArray[np.int64]]:
    size = path.stat().st_size
    if not size:
        raise MeshError(f"{path}: the file is empty")
    with path.open("rb") as file:
        kind = find_kind(path, file.read(HEAD_BYTES), size)
    try:
        data = _READERS[kind](path)
        triangles = split_faces(path, data)
    except (MeshError, MemoryError):
        raise
    except ModuleNotFoundError as error:
        raise MeshError(f"{path}: reading it needs the package '{error.name}', install trocar[mesh]") from error
    except Exception as error:  # The readers raise whatever a broken file trips them over.
        raise MeshError(f"{path}: not a readable triangle surface ({error})") from error
    name = kind.rpartition(" ")[2]
    if path.suffix.lower() != f".{name}":
        data.actions.insert(0, f"read as {name.upper()}, which it is, whatever its name says")
    return data, triangles


def _npy(array: npt.NDArray[np.generic]) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()
