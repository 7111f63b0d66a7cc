"""Physics ticks under hard hands: what share takes more than one and two milliseconds of processor time.

    OPENBLAS_NUM_THREADS=1 GLIBC_TUNABLES=glibc.malloc.hugetlb=1 python benchmarks/bench_hard_ticks.py [--cases 14]

The cases are those of the stability families, drawn by a seed: hands that jerk at up to 2 m/s, and hands that play at
random. Each is run so many times from the start; runs are alike to the bit, so the least time of each tick is what its
arithmetic takes, and what the machine did beside it drops out. Time is the thread's processor time.
"""

from __future__ import annotations

import gc
import random
import time

import numpy as np
from report import Row, parse, write_report

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.drive import Play, reduced_duct
from trocar.studies.stability.families import FAMILIES
from trocar.studies.stability.family import Draw, Reach

#: Of a case, ticks before this one compile and load what it calls for; a piece of random play goes on for 15,000.
FIRST_TICK, LAST_TICK = 5, 1_500
HARD = {"jerks": "jerks of up to 2 m/s", "random_play": "random play"}


def main() -> None:
    """Time all ticks of some cases of each family."""
    arguments = parse(__doc__, cases=(14, "cases of each family"), seed=(1, "draws them"), runs=(2, "of each case"))
    rows = []
    for family, what in HARD.items():
        cases = FAMILIES[family].cases(Draw(Reach.LONG, arguments.seed))
        drawn = random.Random(arguments.seed).sample([case.play for case in cases if case.play], arguments.cases)
        ticks_s = np.concatenate([least_ticks_s(play(), arguments.runs) for play in drawn])
        rows += report_rows(what, ticks_s)
    write_report("hard_ticks", "Physics ticks under hard hands", rows, __doc__.split("\n\n", 2)[2])


def least_ticks_s(play: Play, runs: int) -> FloatArray:
    """Return the least time that each tick of a play took in some runs."""
    least_s: FloatArray = np.min([ticks_s(play) for _ in range(runs)], axis=0)
    return least_s[FIRST_TICK:]


def ticks_s(play: Play) -> FloatArray:
    """Return the processor time of each tick of a play, as far as there are hands."""
    simulation, tools = Simulation(play.scene, reduced_duct(play.scene, play.mesh)), ToolInputs()
    taken_s = np.zeros(min(len(play.hands), LAST_TICK))
    gc.disable()
    for tick in range(len(taken_s)):
        play.hands.write(tick, tools)
        if play.before_step is not None:
            play.before_step(simulation, tick)
        start_ns = time.thread_time_ns()
        simulation.step(tools, play.dt_s)
        taken_s[tick] = 1e-9 * (time.thread_time_ns() - start_ns)
    gc.enable()
    return taken_s


def report_rows(what: str, ticks_s: FloatArray) -> list[Row]:
    """Return the rows of a family: median, 99th percentile, and the shares of long ticks."""
    median_us, p99_us = 1e6 * np.percentile(ticks_s, [50, 99])
    rows = [Row(f"{what}: tick", median_us, "us", p99=p99_us, note=f"{len(ticks_s):,} ticks")]
    for longest_ms, limit in ((1, 0.2), (2, 0.0)):
        share = 100.0 * float(np.mean(ticks_s > 1e-3 * longest_ms))
        rows.append(Row(f"{what}: ticks above {longest_ms} ms", share, "%", limit))
    return rows


if __name__ == "__main__":
    main()
