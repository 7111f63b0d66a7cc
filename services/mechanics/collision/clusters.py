"""Bounding spheres for candidate lists: of triangles, of clusters of neighbours, and of groups of clusters.

Three levels are enough: ten thousand triangles make 512 clusters in 32 groups, and a capsule is near two or three
groups.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.collision.primitives import parameter_on_segment
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import Vector, along, put_row, row, scaled, squared_distance, subtract

#: Maximum number of triangles of a cluster: their sphere is hardly larger than that of a triangle and its neighbours.
CLUSTER_TRIANGLES = 24
#: Number of clusters of a group. A search tests the fewest spheres if it is about the square root of their number.
GROUP_CLUSTERS = 16


class Clusters(Struct):
    """m triangles in c clusters; middles and radii (m) are those of the last `enclose` of each cluster.

    There are s spheres of clusters and, behind them, of groups.
    """

    triangles: Annotated[IntArray, "m", 3]
    order: Annotated[IntArray, "m"]  # triangles sorted by cluster
    first: Annotated[IntArray, "c + 1"]  # index in ``order`` at which each cluster begins
    middle: Annotated[FloatArray, "m", 3]
    radius: Annotated[FloatArray, "m"]
    sphere_middle: Annotated[FloatArray, "s", 3]
    sphere_radius: Annotated[FloatArray, "s"]
    slack_m: Annotated[FloatArray, "s"]  # bound on the motion of what a sphere encloses since then


def cluster_triangles(vertices_m: FloatArray, triangles: IntArray) -> Clusters:
    """Divide triangles (m, 3) into clusters by median splits along the longest side of their bounding box."""
    centroids = vertices_m[triangles].mean(axis=1)
    pieces, pending = [], [np.arange(len(triangles), dtype=np.int32)]
    while pending:
        piece = pending.pop()
        if len(piece) <= CLUSTER_TRIANGLES:
            pieces.append(piece)
            continue
        points = centroids[piece]
        by_side = piece[np.argsort(points[:, int(np.argmax(np.ptp(points, axis=0)))], kind="stable")]
        pending += [by_side[: len(piece) // 2], by_side[len(piece) // 2 :]]
    first = np.concatenate([[0], np.cumsum([len(piece) for piece in pieces])]).astype(np.int32)
    corners = np.ascontiguousarray(triangles, np.int32)
    extents = {"m": len(triangles), "s": len(pieces) + -(-len(pieces) // GROUP_CLUSTERS), "c + 1": len(first)}
    return Clusters.zeros(triangles=corners, order=np.concatenate(pieces), first=first, **extents)


@kernel
def enclose(clusters: Clusters, c: int, position: FloatArray) -> None:
    """Compute the bounding spheres of a cluster and its triangles, with the nodes at ``position`` (n, 3)."""
    corner, first, end = clusters.triangles, clusters.first[c], clusters.first[c + 1]
    sphere_middle, radius = (0.0, 0.0, 0.0), 0.0
    for entry in range(first, end):
        t = clusters.order[entry]
        u, v, w = row(position, corner[t, 0]), row(position, corner[t, 1]), row(position, corner[t, 2])
        middle = centroid(u, v, w)
        longest_2 = max(squared_distance(u, middle), squared_distance(v, middle), squared_distance(w, middle))
        put_row(clusters.middle, t, middle)
        clusters.radius[t] = math.sqrt(longest_2)
        sphere_middle = along(sphere_middle, middle, 1.0 / (end - first))
    for entry in range(first, end):
        t = clusters.order[entry]
        radius = max(radius, math.sqrt(squared_distance(row(clusters.middle, t), sphere_middle)) + clusters.radius[t])
    put_row(clusters.sphere_middle, c, sphere_middle)
    clusters.sphere_radius[c] = radius


@kernel
def centroid(a: Vector, b: Vector, c: Vector) -> Vector:
    """Return the centroid of a triangle."""
    return scaled((a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]), 1.0 / 3.0)


@kernel
def enclose_group(clusters: Clusters, group: int) -> None:
    """Compute the bounding sphere of a group from the spheres of its clusters and their slack."""
    n = clusters.first.shape[0] - 1
    first, end = group * GROUP_CLUSTERS, min((group + 1) * GROUP_CLUSTERS, n)
    middle, radius = (0.0, 0.0, 0.0), 0.0
    for c in range(first, end):
        middle = along(middle, row(clusters.sphere_middle, c), 1.0 / (end - first))
    for c in range(first, end):
        distance = math.sqrt(squared_distance(row(clusters.sphere_middle, c), middle))
        radius = max(radius, distance + clusters.sphere_radius[c] + clusters.slack_m[c])
    put_row(clusters.sphere_middle, n + group, middle)
    clusters.sphere_radius[n + group], clusters.slack_m[n + group] = radius, 0.0


@kernel
def vector_from_segment(a: Vector, b: Vector, point: Vector) -> Vector:
    """Return the vector from the closest point of segment ab to a point."""
    return along(subtract(point, a), subtract(b, a), -parameter_on_segment(point, (a, b)))
