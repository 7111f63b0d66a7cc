"""Cells of mesh files of finite elements: the faces among them, and their groups as named sets of vertices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trocar.services.meshes.announced import judge_counts
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.surface_data import DoubleArray, Int64Array, SurfaceData

FACES = {
    "triangle": 3, "triangle6": 3, "triangle7": 3, "quad": 4, "quad8": 4, "quad9": 4, "polygon": 0,
}  # fmt: skip
"""Kinds of cells that are faces, with the number of their corners, which come first; 0: as many as they have nodes."""
MOST_SETS = 1_000


@dataclass(slots=True)
class Cells:
    """Cells of one kind.

    Attributes:
        kind: As the library meshio names it: triangle, quad, triangle6, line, tetra and so on.
        nodes: (n, nodes of each) vertices.
        members: Of groups, the indices of the cells.
    """

    kind: str
    nodes: Int64Array
    members: Mapping[str, Int64Array] = field(default_factory=dict)


def surface_of(
    path: Path, vertices: DoubleArray, blocks: Iterable[Cells], sets: Mapping[str, Int64Array]
) -> SurfaceData:
    """Return the faces among cells; groups of cells become sets of their vertices, beside ``sets``.

    Lines and points are left out but for their groups; so are solid cells, if there are faces beside them.
    Raises MeshError if there is no face, or a cell names a vertex that is not there.
    """
    corners, counts, named, others, actions = [], [], dict(sets), dict[str, int](), list[str]()
    second_order = 0
    for block in blocks:
        _check_nodes(path, block, len(vertices))
        for group, members in block.members.items():
            _add(named, group, block.nodes[members])
        if block.kind not in FACES:
            others[block.kind] = others.get(block.kind, 0) + len(block.nodes)
            continue
        n = FACES[block.kind] or block.nodes.shape[1]
        second_order += len(block.nodes) if block.nodes.shape[1] > n else 0
        corners.append(block.nodes[:, :n].ravel())
        counts.append(np.full(len(block.nodes), n, np.int64))
    left_out = ", ".join(f"{n} of kind {kind}" for kind, n in others.items() if n)
    if not sum(map(len, counts)):
        raise MeshError(
            f"{path}: holds no triangle or quadrilateral" + (f", but cells: {left_out}" if left_out else "")
        )
    if left_out:
        actions.append(f"left out cells that are no faces: {left_out}")
    if second_order:
        actions.append(f"took the corners of {second_order} faces of second order, whose edges are straight now")
    if len(named) > MOST_SETS:
        raise MeshError(f"{path}: has {len(named)} groups, at most {MOST_SETS} are read")
    every = np.concatenate(counts)
    judge_counts(path, int(np.maximum(every - 2, 0).sum()), len(vertices))
    return SurfaceData(vertices, np.concatenate(corners), every, actions=actions, sets=named)


def _check_nodes(path: Path, block: Cells, n: int) -> None:
    strange = np.argwhere((block.nodes < 0) | (block.nodes >= n))
    if len(strange):
        cell, at = strange[0]
        raise MeshError(
            f"{path}: cell {cell} of kind {block.kind} names vertex {block.nodes[cell, at]}, there are {n}, from 0 on"
        )


def _add(named: dict[str, Int64Array], group: str, nodes: Int64Array) -> None:
    before = named.get(group, np.zeros(0, np.int64))
    named[group] = np.union1d(before, nodes.ravel())
