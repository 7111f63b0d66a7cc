"""Triangle surfaces from STL, OBJ, PLY and VTP files, in declared units."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.units import METRES_PER_UNIT
from trocar.services.meshes.announced import judge_file, judge_place
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.obj_file import read_obj
from trocar.services.meshes.vtp_file import read_vtp

COORDINATE_MAX_M = 1e9
"""Of a coordinate: beyond, the file is broken, and squares of lengths soon are not numbers."""
READABLE = (".stl", ".obj", ".ply", ".vtp")


def read_surface(path: Path, units: str) -> TriangleMesh:
    """Read a surface as it stands, polygons split into triangles, positions in metres.

    Raises MeshError if the file is missing, unreadable, cut off, of another kind, too large or too far away, holds no
    triangles, or has faces that name vertices that are not there.

    Args:
        path: STL, OBJ, PLY or VTP.
        units: Unit of length in the file, which no such format states: m, cm, mm, um or in.
    """
    if units not in METRES_PER_UNIT:
        raise MeshError(f"{path}: unknown units '{units}'; known: {', '.join(METRES_PER_UNIT)}")
    if path.suffix.lower() not in READABLE:
        raise MeshError(f"{path}: cannot read '{path.suffix}' files; readable: {', '.join(READABLE)}")
    judge_place(path)
    announced = judge_file(path)
    read = {".vtp": read_vtp, ".obj": read_obj}.get(path.suffix.lower(), _read_with_trimesh)
    try:
        vertices, triangles = read(path)
        mesh = TriangleMesh(vertices * METRES_PER_UNIT[units], triangles) if len(triangles) else None
    except (MeshError, ModuleNotFoundError):
        raise
    except Exception as error:  # The readers raise whatever a broken file trips them over.
        raise MeshError(f"{path}: not a readable triangle surface ({error})") from error
    if path.suffix.lower() == ".ply" and len(triangles) < announced:
        raise MeshError(f"{path}: the file is cut off, it announces {announced} faces and holds {len(triangles)}")
    if mesh is None:
        raise MeshError(f"{path}: the file holds no triangles")
    furthest = int(np.abs(mesh.vertices_m).max(axis=1).argmax())
    distance_m = float(np.abs(mesh.vertices_m[furthest]).max())
    if distance_m > COORDINATE_MAX_M:
        raise MeshError(f"{path}: vertex {furthest} is {distance_m:.3g} m from the origin, no shell lies so far")
    return mesh


def _read_with_trimesh(path: Path) -> tuple[FloatArray, IntArray]:
    import trimesh

    surface = trimesh.load(path, force="mesh", process=False)
    return np.asarray(surface.vertices, np.float64), np.asarray(surface.faces, np.int32)
