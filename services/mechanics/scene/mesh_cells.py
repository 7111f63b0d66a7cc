"""Mesh density of a parametric duct at which the force on jaws is converged to about a per cent."""

from __future__ import annotations

import math

ROUND, ALONG = 9.0, 1.75
"""Cells on a quarter of a ring, and on half the length, per unit of length in `accurate_cells`."""
MOST_NODES = 6_000
"""Limit of the nodes, because modes of more take too long: four seconds at the first start."""
MOST_NODES_ALL_PAIRS = 3_800
"""Limit of the nodes if the residual compliance between all pairs is to be kept in memory."""


def accurate_cells(
    radius_m: float, length_m: float, jaw_radius_m: float, most_nodes: int = MOST_NODES
) -> tuple[int, int]:
    """Return the cells round and along a tube of that mid-surface for jaws of that radius.

    A jaw's load has the jaw's width and bends the wall over about l = sqrt(R r_jaw). Forces act on the corners of a
    triangle, so a cell of size h widens them by a variance of h²/6: that is four fifths of the error of a pinch, and
    falls with (h / l)². The other fifth comes from flat facets, which lie inside the circle by pi² / 3 n² of its radius
    on average; errors of the elements are smaller. Measured for R of 3 to 6 mm and walls of 0.5 to 1.2 mm, a pinch over
    1 mm is within 0.8 to 1 % of the limit of infinitely fine meshes (docs/decisions/default-mesh.md). Cells are shorter
    round the tube than along it, where the wall bends less.

    If that takes more than ``most_nodes`` nodes, both numbers are reduced by the same factor.
    """
    scale_m = math.sqrt(radius_m * jaw_radius_m)
    around, along = ROUND * radius_m / scale_m, ALONG * length_m / scale_m
    share = min(1.0, math.sqrt(most_nodes / (4.0 * around * (2.0 * along + 1.0))))
    # A quarter of a ring in whole cells: the mesh is the same from all four sides.
    n_around = min(4 * max(2, math.floor(share * around + 0.5)), most_nodes // 20 * 4)
    return n_around, min(2 * max(2, math.floor(share * along + 0.5)), most_nodes // n_around - 1)
