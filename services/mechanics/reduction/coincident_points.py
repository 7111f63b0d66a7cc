"""Contact points that stand in the list twice: the compliance between them is the same, and is copied.

A film of mucus has a row beside that of the contact it lies in, at the same point of the wall.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel

Points = tuple[IntArray, FloatArray]


@kernel
def find_sources(points: Points, source: IntArray, from_point: int) -> None:
    """Write for each point, (nodes (k, 3), weights (k, 3)), the first that is the same one; mostly it is itself.

    Those from ``from_point`` on are not told to be the same as one before it: the blocks of that are turned by now.
    """
    nodes, weights = points
    for a in range(nodes.shape[0]):
        source[a] = a
        for b in range(from_point if a >= from_point else 0, a):
            if _is_same(nodes, weights, a, b):
                source[a] = b
                break


@inlined_kernel
def _is_same(nodes: IntArray, weights: FloatArray, a: int, b: int) -> bool:
    for corner in range(3):
        if nodes[a, corner] != nodes[b, corner] or weights[a, corner] != weights[b, corner]:
            return False
    return True


@kernel
def is_copied(source: IntArray, a: int, b: int) -> bool:
    """Return whether the block of two points, b <= a, is there already, and not only its mirror image.

    The image would do but for its last bit: its sums are formed in another order.
    """
    return bool(source[a] != a or source[b] != b) and bool(source[a] > source[b] or a == b)


@kernel
def copy_coincident(source: IntArray, out: FloatArray, from_point: int) -> None:
    """Fill in the lower blocks of ``out`` (3 k, 3 k) that `is_copied` names, from a point on."""
    for a in range(from_point, source.shape[0]):
        for b in range(a + 1):
            if is_copied(source, a, b):
                for i in range(3):
                    for j in range(3):
                        out[3 * a + i, 3 * b + j] = out[3 * source[a] + i, 3 * source[b] + j]
