"""The surface in a VTU file; whole numbers on its points and cells are groups."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.meshes.cells import Cells, surface_of
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.surface_data import Int64Array, SurfaceData, strip_triangles
from trocar.services.meshes.vtp_file import points_of, read_by_vtk

_KINDS = {
    1: "vertex", 2: "vertex", 3: "line", 4: "line", 5: "triangle", 7: "polygon", 8: "pixel", 9: "quad", 10: "tetra",
    11: "voxel", 12: "hexahedron", 13: "wedge", 14: "pyramid", 21: "line3", 22: "triangle6", 23: "quad8",
    24: "tetra10", 25: "hexahedron20", 26: "wedge15", 28: "quad9", 34: "triangle7",
}  # fmt: skip
"""Kinds of cells by VTK's numbers; those of strips are several triangles."""
_STRIP, _PIXEL = 6, 8  # by the numbers of VTK's cells
_MOST_VALUES = 64
"""Different numbers up to which an array tells groups; beyond, it numbers things."""


def read_vtu(path: Path) -> SurfaceData:
    """Return the faces of a grid; an array of 0 and 1 is a set, one of other whole numbers a set ``NAME=3`` of each.

    Raises MeshError: says what VTK said first, or that there is no face.
    """
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    grid = read_by_vtk(path, vtkXMLUnstructuredGridReader())
    on_points, on_cells = _groups(grid.GetPointData()), _groups(grid.GetCellData())
    for name, members in (on_points | on_cells).items():
        n = grid.GetNumberOfPoints() if name in on_points else grid.GetNumberOfCells()
        if len(members) != n:
            raise MeshError(f"{path}: its array '{name.partition('=')[0]}' has {len(members)} entries, not {n}")
    sets = {name: np.flatnonzero(members).astype(np.int64) for name, members in on_points.items()}
    return surface_of(path, points_of(grid), _blocks(path, grid, on_cells), sets)


def _blocks(path: Path, grid: Any, groups: dict[str, np.ndarray[Any, np.dtype[Any]]]) -> Iterator[Cells]:
    """Yield the cells of each kind and number of nodes, with the groups that they are in."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if not grid.GetNumberOfCells():
        return
    types = np.asarray(vtk_to_numpy(grid.GetCellTypesArray()), np.int64)
    offsets = np.asarray(vtk_to_numpy(grid.GetCells().GetOffsetsArray()), np.int64)
    nodes = np.asarray(vtk_to_numpy(grid.GetCells().GetConnectivityArray()), np.int64)
    counts = np.diff(offsets)
    if len(counts) != len(types) or (counts < 0).any() or offsets[0] < 0 or offsets[-1] > len(nodes):
        raise MeshError(f"{path}: the offsets of its cells do not fit the {len(nodes)} corners that it holds")
    for kind, count in itertools.product(np.unique(types).tolist(), np.unique(counts).tolist()):
        chosen = np.flatnonzero((types == kind) & (counts == count))
        if not len(chosen) or not count:
            continue
        block: Int64Array = nodes[offsets[chosen, None] + np.arange(count)]
        if kind == _STRIP:
            parts = [strip_triangles(strip) for strip in block]
            chosen = np.repeat(chosen, [len(part) for part in parts])
            block = np.concatenate(parts)
        if kind == _PIXEL:
            block = block[:, [0, 1, 3, 2]]
        name = {_STRIP: "triangle", _PIXEL: "quad"}.get(kind, _KINDS.get(kind, f"VTK {kind}"))
        members = {group: np.flatnonzero(is_in[chosen]) for group, is_in in groups.items()}
        yield Cells(name, block, members={group: found for group, found in members.items() if len(found)})


def _groups(data: Any) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    """Return who is in each group that arrays of whole numbers tell."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    found: dict[str, np.ndarray[Any, np.dtype[Any]]] = {}
    for k in range(data.GetNumberOfArrays()):
        array = data.GetArray(k)
        if array is None or array.GetNumberOfComponents() != 1 or array.GetName() in (None, "vtkGhostType"):
            continue
        values = vtk_to_numpy(array)
        if values.dtype.kind not in "iu":
            continue
        different = np.unique(values)
        if set(different.tolist()) <= {0, 1}:
            found[array.GetName()] = values == 1
        elif len(different) <= _MOST_VALUES:
            found |= {f"{array.GetName()}={value}": values == value for value in different.tolist()}
    return found
