"""Quantiles within a bucket of the truth, and misses counted exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.services.runtime.measures.histogram import BUCKETS, LatencyHistogram, edges_ns, late, quantiles_us


def test_the_deadline_is_an_edge_and_what_meets_it_is_in_time() -> None:
    for deadline in (1_000_000, 33_333_333, 16_666_667):
        histogram = LatencyHistogram(deadline)
        for duration in (deadline - 1, deadline, deadline + 1, deadline + 2):
            histogram.record(duration)
        edge = int(np.flatnonzero(edges_ns(deadline) == deadline)[0])  # the bucket below it ends there
        assert histogram.counts[edge] == histogram.counts[edge + 1] == 2
        assert late(histogram.counts) == 2


@given(st.integers(0, 10**12))
def test_each_duration_falls_between_its_edges(duration: int) -> None:
    histogram = LatencyHistogram(1_000_000)
    histogram.record(duration)
    index = int(np.flatnonzero(histogram.counts)[0])
    edges = edges_ns(1_000_000)
    low = edges[index - 1] if index > 0 else -1.0
    high = edges[index] if index < BUCKETS - 1 else np.inf
    assert low * (1 - 1e-12) < duration <= high * (1 + 1e-12)


def test_quantiles_are_those_of_the_samples() -> None:
    chance = np.random.default_rng(1)
    samples = np.exp(chance.normal(np.log(80_000), 0.8, 50_000)).astype(int)
    histogram = LatencyHistogram(1_000_000)
    for sample in samples:
        histogram.record(int(sample))
    found = quantiles_us(histogram.counts, 1_000_000, histogram.max_ns)
    truth = np.quantile(samples, [0.5, 0.99, 0.999]) / 1e3
    np.testing.assert_allclose([found.p50, found.p99, found.p99_9], truth, rtol=0.025)
    assert found.max == pytest.approx(samples.max() / 1e3)
    assert histogram.sum_ns == samples.sum()


def test_nothing_counted_is_not_a_number() -> None:
    assert np.isnan(quantiles_us(np.zeros(BUCKETS, np.int64), 1_000_000).p50)


def test_negative_and_endless_durations_stay_in_the_table() -> None:
    histogram = LatencyHistogram(1_000_000)
    for duration in (-5, 0, 10**18):
        histogram.record(duration)
    assert histogram.counts[0] == 2
    assert histogram.counts[-1] == 1


durations = st.lists(st.integers(-1000, 10**11), max_size=60)


@given(durations, durations, st.integers(10_000, 10**9))
def test_the_sum_of_two_is_that_of_all_their_durations(first: list[int], second: list[int], deadline_ns: int) -> None:
    one, other, both = (LatencyHistogram(deadline_ns) for _ in range(3))
    for histogram, values in ((one, first), (other, second), (both, first + second)):
        for value in values:
            histogram.record(value)
    assert (one.counts + other.counts == both.counts).all()
    assert one.sum_ns + other.sum_ns == both.sum_ns
    assert max(one.max_ns, other.max_ns) == both.max_ns
    assert late(both.counts) == sum(value > deadline_ns for value in first + second)
