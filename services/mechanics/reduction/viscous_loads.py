"""Relaxation of the residual displacement of a viscoelastic wall: a dent grows under a lasting force and lingers.

The residual responds elastically and at once, u = R p. All stiffnesses of the wall relax by one Prony series, so the
contact loads f balance p - sum_k g_k h_k with h_k' = (p - h_k) / tau_k. Node by node that is p = f + sum_k g_k h_k,
where the sum is called the lagging load. A dent under a lasting force grows to R f / (1 - sum g).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.memory import SavedRows
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import copy_rows
from trocar.services.mechanics.reduction.residual.blocks import BlockStore, block_between, store_at
from trocar.services.mechanics.reduction.residual.node_numbering import forget_numbers, number_node
from trocar.services.mechanics.reduction.viscoelastic import PronySeries, follow

LEAST_N = 1e-6
"""A lagging load below this is dropped where nothing presses."""
MOST_LEFT = 32
"""At most so many nodes keep a lagging load after their contact has ended; beyond it the smallest are dropped."""


class LaggingLoads(Struct):
    """The nodes that lag, each once; the first ``count`` mean something."""

    g: Annotated[FloatArray, "t"]
    decay: Annotated[FloatArray, "t"]
    node: Annotated[IntArray, "m"]
    lag: Annotated[FloatArray, "m", "t", 3]  # h
    total: Annotated[FloatArray, "m", 3]  # sum of g h in the next step
    lasting: Annotated[FloatArray, "m", 3]  # the same, which a wall whose sections turn turns to world axes
    load: Annotated[FloatArray, "m", 3]  # p of the last tick
    pressed: Annotated[LongArray, "m"]  # scratch
    slot: Annotated[IntArray, "n"]  # scratch, all -1
    count: Annotated[LongArray, 1]


lagging_at = reader(LaggingLoads)


class ViscousLoads:
    """Lagging loads of up to ``capacity`` nodes of a wall of ``n_nodes``.

    After each step `relax_loads` replaces the contact loads f by the loads p that act through the residual. Without its
    contacts the wall is displaced by R times ``lasting``.

    Attributes:
        relaxed_s: float. For how long loads have relaxed so far.
    """

    def __init__(self, series: PronySeries, n_nodes: int, capacity: int) -> None:
        self._tau_s, self._dt_s = np.array(series.tau_s), float("nan")
        slot, g = np.full(n_nodes, -1, np.int32), np.array(series.g)
        # Places for those that were pressed in the last tick, for what is left of before, and for others in this one.
        self._arrays = LaggingLoads.zeros(g=g, slot=slot, t=len(g), m=2 * capacity + MOST_LEFT, n=n_nodes)
        arrays = self._arrays
        self._start = SavedRows([arrays.node, arrays.lag, arrays.total, arrays.lasting, arrays.load])
        self.relaxed_s = 0.0

    @property
    def lasting(self) -> tuple[IntArray, FloatArray]:
        """Nodes (c,) and their lagging loads (c, 3) in N, along world axes."""
        count = self._arrays.count.item(0)
        return self._arrays.node[:count], self._arrays.lasting[:count]

    @property
    def address(self) -> Address[LaggingLoads]:
        """The nodes that lag, for `relax_loads`."""
        return self._arrays.address

    def begin_step(self, dt_s: float) -> None:
        """Prepare for `relax_loads` at the end of a step of this length."""
        if dt_s != self._dt_s:
            self._arrays.decay[:] = np.exp(-dt_s / self._tau_s)
            self._dt_s = dt_s
        self.relaxed_s += dt_s

    def lost_j(self, store: BlockStore, time_s: float) -> float:
        """Return what relaxing for a last time under the same loads has lost; ``store`` are the residual's blocks.

        It sums over all pairs of nodes, which is too slow for a tick: for energy balances.
        """
        lost = self._arrays.g * np.expm1(2.0 * time_s / self._tau_s)
        return 0.5 * float(spread_energy(self._arrays.address, store.address, lost, 0.0))

    def extra_energy_j(self, store: BlockStore) -> float:
        """Return what the springs of all terms store less p R p / 2, which the duct reports."""
        arrays = self._arrays
        return 0.5 * float(spread_energy(arrays.address, store.address, arrays.g, -float(arrays.g.sum())))

    def save_start(self) -> None:
        """Save the loads where a step begins: all that there is room for are a quarter of a megabyte."""
        self._start.save(self._arrays.count.item(0))

    def restore_start(self) -> None:
        """Restore them."""
        self._start.restore()
        self._arrays.count[0] = self._start.count

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        arrays = self._arrays
        return arrays.node, arrays.lag, arrays.total, arrays.lasting, arrays.load, arrays.count


@kernel
def relax_loads(address: Address[LaggingLoads], nodes: IntArray, forces: FloatArray, n_loads: int) -> int:
    """Take loads on, write p over them, let the lag follow p, and forget what is too small; returns how many p.

    Contact forces (l, 3) on nodes (l,), each node once, of which the first ``n_loads`` count, are along the axes of the
    wall; what is left of the loads is in ``total``.
    """
    lagging = lagging_at(address)
    count = _take_loads(lagging, nodes, forces, n_loads)
    listed = _list_loads(lagging, count, nodes, forces)
    for place in range(count):
        for term in range(lagging.g.shape[0]):
            follow(lagging.lag[place, term], lagging.load[place], lagging.decay[term])
        for axis in range(3):
            lagging.total[place, axis] = 0.0
            for term in range(lagging.g.shape[0]):
                # At the end of the next step, as if p stayed: h, which followed the p that it ended with, is half a
                # step behind.
                ahead = 0.5 * (1.0 + lagging.decay[term]) * (lagging.load[place, axis] - lagging.lag[place, term, axis])
                lagging.total[place, axis] += lagging.g[term] * (lagging.load[place, axis] - ahead)
    lagging.count[0] = _forget(lagging, count)
    copy_rows(lagging.total, lagging.lasting, lagging.count[0])
    return listed


@kernel
def _take_loads(lagging: LaggingLoads, nodes: IntArray, forces: FloatArray, n_loads: int) -> int:
    """Write p of the nodes that lag or are loaded, and return how many."""
    count = lagging.count[0]
    for place in range(count):
        lagging.slot[lagging.node[place]] = place
        lagging.pressed[place] = 0
        for axis in range(3):
            lagging.load[place, axis] = lagging.total[place, axis]
    for load in range(n_loads):
        place = number_node(nodes[load], lagging.slot, lagging.node, count)
        if place == count:
            count += 1
            for axis in range(3):
                lagging.load[place, axis] = 0.0
                for term in range(lagging.g.shape[0]):
                    lagging.lag[place, term, axis] = 0.0
        lagging.pressed[place] = 1
        for axis in range(3):
            lagging.load[place, axis] += forces[load, axis]
    forget_numbers(lagging.slot, lagging.node, count)
    return int(count)


@kernel
def _list_loads(lagging: LaggingLoads, count: int, nodes: IntArray, forces: FloatArray) -> int:
    """Overwrite the loads with p and return how many; where there is no room for all, pressed nodes come first."""
    room, listed = nodes.shape[0], 0
    fits = count <= room
    for pressed in (1, 0):
        for place in range(count):
            if listed < room and (fits or lagging.pressed[place] == pressed):
                nodes[listed] = lagging.node[place]
                for axis in range(3):
                    forces[listed, axis] = lagging.load[place, axis]
                listed += 1
        if fits:
            break
    return listed


@kernel
def _forget(lagging: LaggingLoads, count: int) -> int:
    """Drop nodes that nothing presses and that hardly lag, then the least of too many, and return how many are left."""
    left, place = 0, 0
    while place < count:
        if lagging.pressed[place] == 0 and _lag_of(lagging, place) < LEAST_N:
            count -= 1
            _move(lagging, count, place)
        else:
            left += 1 - lagging.pressed[place]
            place += 1
    while left > MOST_LEFT:
        least, least_n = 0, np.inf
        for place in range(count):
            if lagging.pressed[place] == 0 and _lag_of(lagging, place) < least_n:
                least, least_n = place, _lag_of(lagging, place)
        count, left = count - 1, left - 1
        _move(lagging, count, least)
    return count


@kernel
def _lag_of(lagging: LaggingLoads, place: int) -> float:
    """Return the largest component of all terms of a node."""
    largest = 0.0
    for term in range(lagging.g.shape[0]):
        for axis in range(3):
            largest = max(largest, abs(lagging.lag[place, term, axis]))
    return largest


@kernel
def _move(lagging: LaggingLoads, here: int, there: int) -> None:
    lagging.node[there], lagging.pressed[there] = lagging.node[here], lagging.pressed[here]
    for axis in range(3):
        lagging.load[there, axis], lagging.total[there, axis] = lagging.load[here, axis], lagging.total[here, axis]
        for term in range(lagging.g.shape[0]):
            lagging.lag[there, term, axis] = lagging.lag[here, term, axis]


@kernel
def spread_energy(
    address: Address[LaggingLoads], store_address: Address[BlockStore], weights: FloatArray, own: float
) -> float:
    """Return ``own`` p R p and the sum over terms of ``weights`` times (p - h) R (p - h)."""
    lagging, store, total = lagging_at(address), store_at(store_address), 0.0
    for a in range(lagging.count[0]):
        for b in range(a + 1):
            block = block_between(store, lagging.node[a], lagging.node[b])
            twice = 1.0 if a == b else 2.0
            for i in range(3):
                for j in range(3):
                    product = own * lagging.load[a, i] * lagging.load[b, j]
                    for term in range(weights.shape[0]):
                        left = lagging.load[a, i] - lagging.lag[a, term, i]
                        product += weights[term] * left * (lagging.load[b, j] - lagging.lag[b, term, j])
                    total += twice * block[3 * i + j] * product
    return total
