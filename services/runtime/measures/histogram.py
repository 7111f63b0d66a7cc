"""Latency histogram with logarithmic buckets and an edge at the deadline: quantiles to 2 %, exact miss ratios."""

from __future__ import annotations

from array import array
from bisect import bisect_left
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

import trocar.protocol.bodies as bodies
from trocar.protocol.arrays import pack

#: Buckets per doubling: edges are 4.4 % apart, so that a bucket's middle is within 2.2 % of its durations.
PER_OCTAVE = 16
#: Doublings below and above the deadline: 1 ms reaches from 1 us to 1 s.
OCTAVES_BELOW = OCTAVES_ABOVE = 10
BUCKETS = PER_OCTAVE * (OCTAVES_BELOW + OCTAVES_ABOVE) + 2  # one more for what is below all edges, one for above
_OFFSET = PER_OCTAVE * OCTAVES_BELOW + 1  # of the first bucket above the deadline


@lru_cache(maxsize=64)  # a rig has a handful; bounded because peers report deadlines
def edges_ns(deadline_ns: int) -> NDArray[np.float64]:
    """Return the upper edges of all buckets but the last, open one: ``deadline * 2**(k / PER_OCTAVE)``, exact at 0.

    A value on an edge counts below it, so a duration equal to the deadline is in time.
    """
    k = np.arange(BUCKETS - 1) - (_OFFSET - 1)
    edges: NDArray[np.float64] = deadline_ns * np.exp2(k / PER_OCTAVE)
    edges.flags.writeable = False  # shared by all callers
    return edges


@cache
def _whole_edges_ns(deadline_ns: int) -> tuple[int, ...]:
    """Return the edges in whole nanoseconds, equivalent for whole durations."""
    return tuple(np.floor(edges_ns(deadline_ns)).astype(np.int64).tolist())


class LatencyHistogram:
    """Counts of durations. Recording costs a quarter of a microsecond and takes no lock; one thread writes.

    Attributes:
        counts: (BUCKETS,) int64
    """

    __slots__ = ("_cells", "_edges_ns", "counts", "deadline_ns", "max_ns", "sum_ns")

    def __init__(self, deadline_ns: int) -> None:
        self.deadline_ns = deadline_ns
        self._edges_ns = _whole_edges_ns(deadline_ns)
        self._cells = array("q", bytes(8 * BUCKETS))  # incrementing costs a third of that of a numpy array
        self.counts: NDArray[np.int64] = np.frombuffer(self._cells, np.int64)
        self.sum_ns = 0
        self.max_ns = 0

    @property
    def total(self) -> int:
        """Number of durations."""
        return int(self.counts.sum())

    def record(self, duration_ns: int) -> None:
        """Count one duration; a negative one counts as zero."""
        self._cells[bisect_left(self._edges_ns, duration_ns)] += 1
        if duration_ns > 0:
            self.sum_ns += duration_ns
            if duration_ns > self.max_ns:
                self.max_ns = duration_ns

    def body(self) -> bodies.Histogram:
        """Return the histogram for the wire."""
        return bodies.Histogram(
            deadline_ns=self.deadline_ns,
            counts=pack(self.counts, "<i8"),
            total=self.total,
            sum_ns=self.sum_ns,
            max_ns=self.max_ns,
        )


@dataclass(frozen=True, slots=True)
class Quantiles:
    """Quantiles of a histogram, in microseconds; NaN if it is empty."""

    p50: float = float("nan")
    p99: float = float("nan")
    p99_9: float = float("nan")
    max: float = float("nan")


def quantile_ns(counts: NDArray[np.int64], deadline_ns: int, q: float, max_ns: float = np.inf) -> float:
    """Return the `q` quantile of bucket `counts`, interpolated inside its bucket and never above `max_ns`."""
    return quantile(counts, edges_ns(deadline_ns), q, max_ns)


def quantile(counts: NDArray[np.int64], edges: NDArray[np.float64], q: float, maximum: float = np.inf) -> float:
    """Return the `q` quantile of `counts` of buckets with upper `edges`, the last one open; NaN if all are empty."""
    total = int(counts.sum())
    if total == 0:
        return float("nan")
    cumulative = np.cumsum(counts)
    rank = q * total
    index = int(np.searchsorted(cumulative, rank, side="left"))
    low = edges[index - 1] if index > 0 else 0.0
    high = edges[index] if index < len(edges) else max(maximum, edges[-1]) if np.isfinite(maximum) else edges[-1]
    inside = (rank - (cumulative[index] - counts[index])) / counts[index]
    return float(min(low + inside * (high - low), maximum))


def quantiles_us(counts: NDArray[np.int64], deadline_ns: int, max_ns: float = np.inf) -> Quantiles:
    """Return median, p99, p99.9 and maximum of bucket `counts` (e.g. the difference of two reports) in microseconds."""
    values = [quantile_ns(counts, deadline_ns, q, max_ns) / 1e3 for q in (0.5, 0.99, 0.999, 1.0)]
    return Quantiles(*values)


def late(counts: NDArray[np.int64]) -> int:
    """Return the exact number of `counts` above the deadline, which is an edge."""
    return int(counts[_OFFSET:].sum())
