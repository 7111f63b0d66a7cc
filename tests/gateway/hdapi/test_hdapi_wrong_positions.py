"""Positions that an arm tells and no hand could have reached: they are held, counted, and not felt."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.hdapi.hdapi_bench import FREE, HdapiBench, two_arms

FORCE_N = (0.0, 0.0, 2.0)
STIFFNESS_N_M = 300.0
FELT_N = 0.05


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[HdapiBench]:
    try:
        with two_arms(tmp_path) as arms:
            arms.by_law = True
            arms.open()
            yield arms
    except BenchUnavailable as reason:
        pytest.skip(str(reason))


def press(bench: HdapiBench, ticks: int) -> None:
    """Press the left arm against something of a stiffness."""
    for _ in range(ticks):
        for driver, reading in bench.readings.items():
            driver.read(bench.standin.clock.monotonic_ns(), reading)
        bench.order(bench.left, np.array(FORCE_N), STIFFNESS_N_M)
        bench.order(bench.right, np.zeros(3))
        bench.wait(1)


def test_a_position_that_is_wrong_for_a_frame_is_not_felt(bench: HdapiBench) -> None:
    bench.run(400, FREE, FREE)
    press(bench, 400)
    before_n = bench.force_n(1)
    assert before_n > 0.5
    rng, strange = np.random.default_rng(7), 0
    for _ in range(60):
        way = rng.normal(size=3)
        frames = int(rng.integers(1, 3))
        wrong = way / np.linalg.norm(way) * rng.uniform(0.045, 0.3)
        begins = len(bench.forces)
        bench.standin.c.standin_wrong(1, ctypes.c_void_p(wrong.ctypes.data), frames)
        press(bench, 20)
        sizes = np.linalg.norm(np.array(bench.forces[begins:])[:, 0], axis=1)
        assert abs(sizes - before_n).max() < FELT_N
        strange += frames
    assert bench.left.gauges()["strange_positions"] == strange
    assert bench.left.fault == ""


def test_a_hand_as_fast_as_any_is_followed(bench: HdapiBench) -> None:
    bench.run(400, FREE, FREE)
    for tick in range(400):
        at = 0.06 * math.sin(50.0 * 1e-3 * tick)  # 3 m/s
        bench.standin.put("place", 1, np.array([at, 0.0, 0.0]))
        bench.run(1, FREE, FREE)
    assert bench.left.gauges()["strange_positions"] == 0.0


def test_a_place_that_stays_is_believed_at_last(bench: HdapiBench) -> None:
    bench.run(400, FREE, FREE)
    bench.standin.put("place", 1, np.array([0.08, 0.0, 0.0]))
    bench.run(20, FREE, FREE)
    assert 1.0 <= bench.left.gauges()["strange_positions"] <= 5.0
    assert abs(bench.readings[bench.left][:3]).max() > 0.07
