"""Durations of a tick's stages, counted in buckets of a quarter of a doubling, from the flight ring's rows.

Nothing is counted in a tick: all rows since the last report are counted at once when a report is made.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import trocar.protocol.bodies as bodies
from trocar.protocol.arrays import Array
from trocar.services.runtime.measures.flight import COLUMNS, ROWS_AT, FlightRing
from trocar.services.runtime.measures.histogram import quantile

#: Buckets reach from 128 ns to 134 ms, four to a doubling and equally wide within it, plus one below and above.
_FIRST_OCTAVE, _OCTAVES, _PER_OCTAVE = 7, 20, 4
BUCKETS = _OCTAVES * _PER_OCTAVE + 2  # one more for what is below all edges, one for above
_FLOAT = np.finfo(np.float32)
_SHIFT = _FLOAT.nmant - _PER_OCTAVE.bit_length() + 1  # leaves the exponent, and the mantissa's bits for four buckets
_BYTES = np.dtype(np.int32).itemsize * BUCKETS
_OFFSET = (1 - int(_FLOAT.minexp) + _FIRST_OCTAVE) * _PER_OCTAVE - 1  # 1 - minexp: bias of the exponent, 127


def edges_ns() -> NDArray[np.float64]:
    """Return the upper edges of all buckets but the last, which is open; (BUCKETS - 1,)."""
    k = np.arange(BUCKETS - 1)
    edges: NDArray[np.float64] = np.exp2(_FIRST_OCTAVE + k // _PER_OCTAVE) * (1.0 + k % _PER_OCTAVE / _PER_OCTAVE)
    return edges


def buckets_of(durations_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bucket of each duration, from exponent and leading mantissa bits of its floating-point value."""
    bits = durations_ns.astype(np.float32).view(np.int32)
    found: NDArray[np.int64] = np.clip((bits >> _SHIFT) - _OFFSET, 0, BUCKETS - 1).astype(np.int64)
    return found


class StageTimes:
    """Counts of the stages of one loop since its start."""

    def __init__(self, ring: FlightRing) -> None:
        self._ring = ring
        self._seen = 0
        self._counts = np.zeros((len(ring.stages), BUCKETS), np.int64)
        self._sum_ns = np.zeros(len(ring.stages), np.int64)
        self._first = BUCKETS * np.arange(len(ring.stages))  # index of each stage's first bucket

    def take_costs(self) -> tuple[bodies.StageCost, ...]:
        """Count the ticks since the last call; return the figures for the wire.

        Ticks that the ring has overwritten do not count. A stage that took no time did not run.
        """
        if not self._ring.stages:
            return ()
        durations = self._new_rows()[:, len(COLUMNS) :]
        ran = durations > 0
        cells = (buckets_of(durations) + self._first)[ran]  # all stages at once, as calls of numpy dominate the cost
        self._counts += np.bincount(cells, minlength=self._counts.size).reshape(self._counts.shape)
        total_ns, runs = durations.sum(axis=0), np.maximum(1, ran.sum(axis=0))
        self._sum_ns += total_ns
        mean_us = (1e-3 * total_ns / runs).tolist()
        max_us = (1e-3 * durations.max(axis=0, initial=0)).tolist()
        sums_us = (1e-3 * self._sum_ns).tolist()
        whole = self._counts.astype("<i4").tobytes()
        counts = [Array("<i4", (BUCKETS,), whole[i : i + _BYTES]) for i in range(0, len(whole), _BYTES)]
        return tuple(
            bodies.StageCost(name=name, mean_us=mean_us[i], max_us=max_us[i], counts=counts[i], sum_us=sums_us[i])
            for i, name in enumerate(self._ring.stages)
        )

    def _new_rows(self) -> NDArray[np.int64]:
        ring = self._ring
        if ring.written < self._seen:  # it was shared, and restarted
            self._seen = 0
        first = max(self._seen, ring.written - ring.capacity)
        self._seen = ring.written
        rows = np.frombuffer(ring.memory, np.int64, offset=ROWS_AT).reshape(ring.capacity, -1)
        return rows[np.arange(first, ring.written) % ring.capacity]


def quantile_us(counts: NDArray[np.int64], q: float, max_us: float = np.inf) -> float:
    """Return the `q` quantile of bucket `counts` in microseconds, interpolated inside its bucket; NaN if empty."""
    return 1e-3 * quantile(counts, edges_ns(), q, 1e3 * max_us)
