"""Triangle surfaces from STL, OBJ, PLY, VTP, VTU, MSH and INP files, in declared units."""

from __future__ import annotations

import io
import itertools
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

Array = np.ndarray[Any, np.dtype[Any]]
COORDINATE_MAX_M = 1e9
"""Of a coordinate: beyond, the file is broken, and squares of lengths soon are not numbers."""
READER = "trocar.services.meshes.foreign"
"""The module that is run in another process."""


def read_surface(path: Path, units: str, actions: list[str] | None = None) -> TriangleMesh:
    """Read a surface as it stands, polygons split into triangles, positions in metres.

    Another process reads it, with limits: whatever is in the file, this one goes on.
    Raises MeshError if the file is missing, unreadable, cut off, of another kind, too large or too far away, holds no
    triangles, or has faces that name vertices that are not there.

    Args:
        path: Told by what is in it: STL, OBJ, PLY or VTP; or VTU, MSH of Gmsh or INP of Abaqus and CalculiX, whose
            groups are sets of vertices.
        units: Unit of length in the file, which no such format states: m, cm, mm, um or in.
        actions: What was done to it is appended.
    """
    if units not in METRES_PER_UNIT:
        raise MeshError(f"{path}: unknown units '{units}'; known: {', '.join(METRES_PER_UNIT)}")
    if path.suffix.lower() not in READABLE and not path.exists():
        raise MeshError(f"{path}: cannot read '{path.suffix}' files; readable: {', '.join(READABLE)}")
    judge_place(path)
    try:
        told, vertices, triangles, members = ask_once(READER, "read", path)
        done, sets = json.loads(told)
        named = _named(_array(members), sets)
        mesh = _mesh(path, (_array(vertices), _array(triangles), named), METRES_PER_UNIT[units])
    except Refusal as error:
        raise MeshError(str(error)) from error
    except MeshError:
        raise
    except ValueError as error:
        raise MeshError(f"{path}: not a readable triangle surface ({error})") from error
    if actions is not None:
        actions += map(str, done)
    return mesh


def _array(npy: bytes) -> Array:
    array: Array = np.load(io.BytesIO(npy), allow_pickle=False)
    return array


def _named(members: Array, sets: list[tuple[str, int]]) -> dict[str, Array]:
    """Return the sets by name, of all members one after the other."""
    ends = np.cumsum([0, *(int(n) for _, n in sets)])
    return {
        str(name): members[first:end] for (name, _), (first, end) in zip(sets, itertools.pairwise(ends), strict=True)
    }


def _mesh(path: Path, held: tuple[Array, Array, dict[str, Array]], unit_m: float) -> TriangleMesh:
    vertices, triangles, sets = held
    if not len(triangles):
        raise MeshError(f"{path}: the file holds no triangles")
    with np.errstate(over="ignore", invalid="ignore"):  # what is no number is told
        mesh = TriangleMesh(vertices * unit_m, triangles, sets)
    furthest = int(np.abs(mesh.vertices_m).max(axis=1).argmax())
    distance_m = float(np.abs(mesh.vertices_m[furthest]).max())
    if distance_m > COORDINATE_MAX_M:
        raise MeshError(f"{path}: vertex {furthest} is {distance_m:.3g} m from the origin, no shell lies so far")
    return mesh
