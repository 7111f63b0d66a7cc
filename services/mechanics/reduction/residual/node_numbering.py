"""Consecutive numbers for the nodes that a few loads or contacts touch, in order of first appearance.

The scratch ``slot`` (n,) holds the number of every node, -1 where it has none; between uses it is all -1.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import IntArray
from trocar.services.mechanics.compiled import kernel


@kernel
def number_node(node: int, slot: IntArray, nodes: IntArray, count: int) -> int:
    """Return the number of a node; a new one is ``count``, and the node is added to ``nodes``."""
    if slot[node] < 0:
        slot[node] = count
        nodes[count] = node
    number: int = slot[node]
    return number


@kernel
def forget_numbers(slot: IntArray, nodes: IntArray, count: int) -> None:
    """Take their numbers from the first ``count`` nodes."""
    for index in range(count):
        slot[nodes[index]] = -1
