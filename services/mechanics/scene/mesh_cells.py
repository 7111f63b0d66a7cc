"""How finely a parametric duct is meshed so that what jaws feel of it is converged to about a per cent."""

from __future__ import annotations

import math

ROUND, ALONG = 9.0, 1.75
"""Cells on a quarter of a ring, and on half the length, per what `accurate_cells` measures lengths in."""
MOST_NODES = 6_000
"""Modes of more take too long, four seconds at the first start."""
MOST_NODES_ALL_PAIRS = 3_800
"""Somewhat fewer than those between all pairs of which the residual compliance is kept in memory."""


def accurate_cells(
    radius_m: float, length_m: float, jaw_radius_m: float, most_nodes: int = MOST_NODES
) -> tuple[int, int]:
    """Return the cells round and along a tube of that mid-surface for jaws of that radius.

    A jaw's load has the jaw's width and bends the wall over about l = sqrt(R r_jaw). Forces act on a triangle by its
    corners, so a cell of size h spreads them by h²/6 more (in variance): that is four fifths of the error of a pinch,
    and it falls with (h / l)². The other fifth is the flat facets, inside the circle by pi² / 3 n² of its radius on
    the mean; elements are finer than either. Measured for R 3 to 6 mm and walls 0.5 to 1.2 mm thick: a pinch spread
    over 1 mm is 0.8 to 1 % off the limit of infinitely fine meshes with these cells
    (docs/decisions/default-mesh.md). Round the tube they are shorter than along it, where less bends.

    Where that would take more than ``most_nodes`` nodes both numbers are as many times smaller.
    """
    scale_m = math.sqrt(radius_m * jaw_radius_m)
    around, along = ROUND * radius_m / scale_m, ALONG * length_m / scale_m
    share = min(1.0, math.sqrt(most_nodes / (4.0 * around * (2.0 * along + 1.0))))
    # A quarter of a ring in whole cells: the mesh is the same from all four sides.
    n_around = min(4 * max(2, math.floor(share * around + 0.5)), most_nodes // 20 * 4)
    return n_around, min(2 * max(2, math.floor(share * along + 0.5)), most_nodes // n_around - 1)
