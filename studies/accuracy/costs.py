"""Costs of ticks, measured in turns on this machine, with fixed arithmetic beside them.

A turn is a few ticks in a row, of which the first is not timed: it brings back to the caches what the others have
pushed out, as on a rig, where physics has a core, nobody does. So a setting costs the same in any company. A tick from
which another program took the core is timed again: on a rig nobody of the ordinary class takes it.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Mapping
from resource import RUSAGE_THREAD, getrusage
from time import perf_counter_ns

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.modal_compliance import add_modal_compliance
from trocar.studies.accuracy.study import Cost, Tick

FLOOR = "fixed arithmetic"
REPEATS = 8
"""Blocks of a measurement: the range of their medians is its noise."""
TIMED_IN_A_ROW = 3
_WARM_UP = 3
_MOST_TRIES = 10


def measure_costs(ticks: Mapping[str, Tick], samples: int) -> dict[str, Cost]:
    """Return what each of these ticks costs, and under `FLOOR` what a fixed piece of arithmetic does beside them.

    Turns go round in an order that turns as well, so that what else the machine does meets all alike. Of each at least
    ``samples`` ticks are timed.
    """
    every = {**ticks, FLOOR: _floor_tick()}
    names = list(every)
    rounds = math.ceil(samples / TIMED_IN_A_ROW)
    times_us = np.empty((len(names), rounds, TIMED_IN_A_ROW))
    for tick in every.values():
        for _ in range(_WARM_UP):
            tick()
    was_collecting = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        for each in range(rounds):
            for turn in range(len(names)):
                k = (each + turn) % len(names)
                tick = every[names[k]]
                tick()
                times_us[k, each] = [_time_us(tick) for _ in range(TIMED_IN_A_ROW)]
    finally:
        if was_collecting:
            gc.enable()
    return {name: _cost(times_us[k].ravel()) for k, name in enumerate(names)}


def _time_us(tick: Tick) -> float:
    took_ns = 0
    for _ in range(_MOST_TRIES):
        switches = getrusage(RUSAGE_THREAD).ru_nivcsw
        start_ns = perf_counter_ns()
        tick()
        took_ns = perf_counter_ns() - start_ns
        if getrusage(RUSAGE_THREAD).ru_nivcsw == switches:
            break
    return 1e-3 * took_ns


def _cost(times_us: FloatArray) -> Cost:
    medians = [float(np.median(block)) for block in np.array_split(times_us, min(REPEATS, times_us.size))]
    noise_us = 0.5 * (max(medians) - min(medians))
    return Cost(float(np.median(times_us)), float(np.percentile(times_us, 99.0)), noise_us)


def _floor_tick() -> Tick:
    """Sums of products that never leave the first two caches, about as long as a tick."""
    modes, gain, scratch, out = np.ones((111, 100)), np.ones(100), np.zeros(111 * 100), np.zeros((111, 111))
    each = np.arange(37, dtype=np.int32)

    def tick() -> None:
        for _ in range(4):
            add_modal_compliance(modes, gain, scratch, out, each, 0)

    return tick
