"""Triangle surfaces from STL, OBJ, PLY and VTP files, in declared units."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.foreign_files import Refusal, ask_once
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.units import METRES_PER_UNIT
from trocar.services.meshes.announced import judge_place
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.file_kind import READABLE

COORDINATE_MAX_M = 1e9
"""Of a coordinate: beyond, the file is broken, and squares of lengths soon are not numbers."""
_MODULE = "trocar.services.meshes.foreign"


def read_surface(path: Path, units: str, actions: list[str] | None = None) -> TriangleMesh:
    """Read a surface as it stands, polygons split into triangles, positions in metres.

    Another process reads it, with limits: whatever is in the file, this one goes on.
    Raises MeshError if the file is missing, unreadable, cut off, of another kind, too large or too far away, holds no
    triangles, or has faces that name vertices that are not there.

    Args:
        path: STL, OBJ, PLY or VTP, told by what is in it.
        units: Unit of length in the file, which no such format states: m, cm, mm, um or in.
        actions: What was done to it is appended.
    """
    if units not in METRES_PER_UNIT:
        raise MeshError(f"{path}: unknown units '{units}'; known: {', '.join(METRES_PER_UNIT)}")
    if path.suffix.lower() not in READABLE and not path.exists():
        raise MeshError(f"{path}: cannot read '{path.suffix}' files; readable: {', '.join(READABLE)}")
    judge_place(path)
    try:
        told, vertices, triangles = ask_once(_MODULE, "read", path)
        done, mesh = json.loads(told), _mesh(path, _array(vertices), _array(triangles), METRES_PER_UNIT[units])
    except Refusal as error:
        raise MeshError(str(error)) from error
    except MeshError:
        raise
    except ValueError as error:
        raise MeshError(f"{path}: not a readable triangle surface ({error})") from error
    if actions is not None:
        actions += map(str, done)
    return mesh


def _array(npy: bytes) -> np.ndarray[Any, np.dtype[Any]]:
    array: np.ndarray[Any, np.dtype[Any]] = np.load(io.BytesIO(npy), allow_pickle=False)
    return array


def _mesh(
    path: Path, vertices: np.ndarray[Any, np.dtype[Any]], triangles: np.ndarray[Any, np.dtype[Any]], unit_m: float
) -> TriangleMesh:
    if not len(triangles):
        raise MeshError(f"{path}: the file holds no triangles")
    with np.errstate(over="ignore", invalid="ignore"):  # what is no number is told
        mesh = TriangleMesh(vertices * unit_m, triangles)
    furthest = int(np.abs(mesh.vertices_m).max(axis=1).argmax())
    distance_m = float(np.abs(mesh.vertices_m[furthest]).max())
    if distance_m > COORDINATE_MAX_M:
        raise MeshError(f"{path}: vertex {furthest} is {distance_m:.3g} m from the origin, no shell lies so far")
    return mesh
