"""The tips of a closed, branching tube: where its ends are to be cut open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.centreline import SurfaceTree, surface_tree
from trocar.services.mechanics.surface.mesh import TriangleMesh, unique_edges
from trocar.services.meshes.errors import MeshError

LENGTH_OF_RADIUS = 2.0
"""A branch that is not so many of its radii long, and one radius of where it leaves, is taken for a bump of the wall,
as the second corner of a flat end has to be."""


@dataclass(frozen=True)
class Way:
    """The rough middle line from the first tip to another one.

    Attributes:
        tips_m: (2, 3) float64. Both tips.
        points_m: (k, 3) float64. Middles of bands, tips excluded.
    """

    tips_m: FloatArray
    points_m: FloatArray


def ways_between_tips(mesh: TriangleMesh, band_m: float) -> list[Way]:
    """Return the way from one of the two tips that are furthest apart to each other tip, the longest first.

    ``mesh`` is closed, with edges that are short beside ``band_m``, the step along the ways.
    Raises MeshError if the surface has a handle: then it is no tree of tubes.
    """
    first = _furthest(surface_tree(mesh, np.array([0], np.int32), band_m))
    first = _furthest(surface_tree(mesh, np.array([first], np.int32), band_m))
    tree = surface_tree(mesh, np.array([first], np.int32), band_m)
    _refuse_handle(mesh, tree)
    taken = {int(tree.node[first])}
    ways: list[Way] = []
    for tip in _leaf_vertices(tree):
        nodes = [int(tree.node[tip])]
        while nodes[-1] not in taken and tree.parent[nodes[-1]] >= 0:
            nodes.append(int(tree.parent[nodes[-1]]))
        if ways and not _is_branch(mesh, tree, tip, nodes):
            continue
        taken.update(nodes)
        ways.append(_way(mesh, tree, first, tip))
    return ways


def _furthest(tree: SurfaceTree) -> int:
    return int(np.argmax(tree.distance_m))


def _leaf_vertices(tree: SurfaceTree) -> list[int]:
    """Return the furthest vertex of each node from which no other goes on, the furthest first."""
    order = np.argsort(-tree.distance_m)
    leaves = np.setdiff1d(np.arange(len(tree.parent)), tree.parent)
    nodes, firsts = np.unique(tree.node[order], return_index=True)
    tips = order[firsts[np.isin(nodes, leaves)]]
    return [int(tip) for tip in tips[np.argsort(-tree.distance_m[tips])]]


def _is_branch(mesh: TriangleMesh, tree: SurfaceTree, tip: int, nodes: list[int]) -> bool:
    """Return whether the way from a leaf to the node where it joins a known way is a branch's, not a bump's."""
    own = np.isin(tree.node, nodes[:-1])
    if not own.any():
        return False
    joint = tree.node == nodes[-1]
    length_m = tree.distance_m[tip] - tree.distance_m[joint].max()
    return bool(length_m > max(LENGTH_OF_RADIUS * _radius_m(mesh, tree, own), _radius_m(mesh, tree, joint)))


def _radius_m(mesh: TriangleMesh, tree: SurfaceTree, own: npt.NDArray[np.bool_]) -> float:
    """Return the mean distance of some vertices from the middles of their bands."""
    return float(np.linalg.norm(mesh.vertices_m[own] - tree.middle_m[tree.node[own]], axis=1).mean())


def _way(mesh: TriangleMesh, tree: SurfaceTree, first: int, tip: int) -> Way:
    nodes = [int(tree.node[tip])]
    while tree.parent[nodes[-1]] >= 0:
        nodes.append(int(tree.parent[nodes[-1]]))
    return Way(mesh.vertices_m[[first, tip]], tree.middle_m[nodes[::-1]])


def _refuse_handle(mesh: TriangleMesh, tree: SurfaceTree) -> None:
    edges, _ = unique_edges(mesh)
    if mesh.n_vertices - len(edges) + mesh.n_triangles == 2:
        return
    pairs = np.unique(np.sort(tree.node[edges], axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    a, b = pairs.T
    meets = pairs[(tree.parent[a] != b) & (tree.parent[b] != a)]
    at = tree.middle_m[meets[-1] if len(meets) else [0]].mean(axis=0)
    raise MeshError(
        f"the duct forms a closed ring, it touches itself or has a hole through its wall, round "
        f"{np.round(1e3 * at, 1).tolist()} mm: part it there"
    )
