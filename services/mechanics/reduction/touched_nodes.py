"""Nodes of a duct that contacts touch now or touched lately, each with a place in the compliance cache.

A catheter at rest trembles over the edges of the mesh: the triangles it touches change in every tick, their nodes
hardly do. So a node keeps its place for `KEPT_TICKS` ticks after its last contact.
"""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np

from trocar.services.mechanics.arrays import IntArray, LongArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct

N_PLACES = 128
KEPT_TICKS = 64
NO_PLACE = -1  # in the place of a number that is at least 0


class TouchedNodes(Struct):
    """Places of the nodes; those in use are among the first ``extent``."""

    place: Annotated[IntArray, "n"]  # of each node of the mesh, or NO_PLACE
    node: Annotated[IntArray, "m"]  # at each place, -1 where it is free
    touched: Annotated[LongArray, "m"]  # tick in which the node there was touched last
    tick: int = 0
    extent: int = 0

    @classmethod
    def of(cls, n_nodes: int, n_places: int = N_PLACES) -> Self:
        """Return places for nodes of a mesh of ``n_nodes``; none has one yet."""
        room = min(n_nodes, n_places)
        return cls.zeros(m=room, place=np.full(n_nodes, NO_PLACE, np.int32), node=np.full(room, -1, np.int32))


@inlined_kernel
def begin_tick(touched: TouchedNodes) -> None:
    """Count a tick, and take their places from the nodes that have not been touched for long."""
    touched.tick += 1
    oldest, extent = touched.tick - KEPT_TICKS, 0
    for place in range(touched.extent):
        node = touched.node[place]
        if node >= 0 and touched.touched[place] < oldest:
            touched.place[node], touched.node[place] = NO_PLACE, -1
        elif node >= 0:
            extent = place + 1
    touched.extent = extent


@kernel
def touch(touched: TouchedNodes, node: int) -> bool:
    """Note that a node is touched in this tick; False where it has no place."""
    place = touched.place[node]
    if place == NO_PLACE:
        return False
    touched.touched[place] = touched.tick
    return True


@inlined_kernel
def give_place(touched: TouchedNodes, node: int) -> int:
    """Give a node the first free place, or that of the node touched longest ago, and return it.

    `NO_PLACE` where every place belongs to a node that is touched in this tick.
    """
    best, oldest = NO_PLACE, touched.tick
    for place in range(touched.node.shape[0]):
        if touched.node[place] < 0:
            best = place
            break
        if touched.touched[place] < oldest:
            best, oldest = place, touched.touched[place]
    if best == NO_PLACE:
        return NO_PLACE
    if touched.node[best] >= 0:
        touched.place[touched.node[best]] = NO_PLACE
    touched.place[node], touched.node[best], touched.touched[best] = best, node, touched.tick
    touched.extent = max(touched.extent, best + 1)
    return best
