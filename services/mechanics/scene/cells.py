"""How finely a parametric duct is meshed so that what jaws feel of it is converged to about a per cent."""

from __future__ import annotations

import math

ROUND, ALONG = 7.0, 1.4
"""Cells on a quarter of a ring, and on half the length, per what `accurate_cells` measures lengths in."""
MOST_NODES = 3_800
"""Somewhat fewer than those between all pairs of which the residual compliance is kept in memory."""


def accurate_cells(radius_m: float, length_m: float, jaw_radius_m: float) -> tuple[int, int]:
    """Return the cells round and along a tube of that mid-surface for jaws of that radius.

    A jaw's load has the jaw's width and bends the wall over about l = sqrt(R r_jaw). Forces act on a triangle by its
    corners, so a cell of size h spreads them by h²/6 more (in variance): that is four fifths of the error of a pinch,
    and it falls with (h / l)². The other fifth is the flat facets, inside the circle by pi² / 3 n² of its radius on
    the mean; elements are finer than either. Measured for R 2.5 to 6 mm and walls 0.5 to 1.2 mm thick: a pinch spread
    over 1 mm is 1.1 to 1.7 % off the limit of infinitely fine meshes with these cells
    (docs/decisions/accuracy-studies.md). Round the tube they are shorter than along it, where less bends.

    Where that would take more than `MOST_NODES` nodes both numbers are as many times smaller.
    """
    scale_m = math.sqrt(radius_m * jaw_radius_m)
    around, along = ROUND * radius_m / scale_m, ALONG * length_m / scale_m
    share = min(1.0, math.sqrt(MOST_NODES / (4.0 * around * (2.0 * along + 1.0))))
    # A quarter of a ring in whole cells: the mesh is the same from all four sides.
    n_around = min(4 * max(2, math.floor(share * around + 0.5)), MOST_NODES // 20 * 4)
    return n_around, min(2 * max(2, math.floor(share * along + 0.5)), MOST_NODES // n_around - 1)
