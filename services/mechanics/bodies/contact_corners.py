"""Corners of the triangles in contact, each once, and the residual displacement of contact points from theirs."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.residual.node_numbering import forget_numbers, number_node


class ContactCorners(Struct):
    """Corners of the touched triangles, each once, as neighbouring contacts share them and each costs a row of R."""

    node: Annotated[IntArray, "3 c"]
    displacement_m: Annotated[FloatArray, "3 c", 3]
    place: Annotated[IntArray, "c", 3]  # index of each contact's corners in `node`

    @classmethod
    def allocate(cls, capacity: int) -> Self:
        """Return arrays for the corners of ``capacity`` contacts."""
        node = np.zeros(3 * capacity, np.int32)
        return cls.zeros(node=node, displacement_m=np.zeros((len(node), 3)), c=capacity)


corners_at = reader(ContactCorners)


@kernel
def list_corners(nodes: IntArray, weights: FloatArray, slot: IntArray, address: Address[ContactCorners]) -> int:
    """List the corners (k, 3) with nonzero weight, each once, and return their number; ``slot`` (n,) is all -1."""
    out, count = corners_at(address), 0
    for point in range(nodes.shape[0]):
        for corner in range(3):
            out.place[point, corner] = 0
            if weights[point, corner] != 0.0:
                place = number_node(nodes[point, corner], slot, out.node, count)
                count = max(count, place + 1)
                out.place[point, corner] = place
    forget_numbers(slot, out.node, count)
    return count


@kernel
def apply_corner_displacements(
    weights: FloatArray, address: Address[ContactCorners], count: int, out: tuple[FloatArray, FloatArray]
) -> None:
    """Add the displacements of the ``count`` corners to those of points, and subtract them from their motions.

    Both of ``out`` are (k, 3), as ``weights``; the corners' displacements are reset to zero.
    """
    corners = corners_at(address)
    moved = corners.displacement_m
    for point in range(weights.shape[0]):
        for axis in range(3):
            total = 0.0
            for corner in range(3):
                total += weights[point, corner] * moved[corners.place[point, corner], axis]
            out[0][point, axis] += total
            out[1][point, axis] -= total
    moved[:count] = 0.0
