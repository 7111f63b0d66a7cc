"""Environments: speed of `trocar/Insertion-v0` with an expert's hands, alone, in processes, on a local Dask cluster.

    python -m benchmarks.bench_envs [--episodes 4]

Processor time of a simulated second is the figure that a busy machine leaves alone; steps a second are by the clock.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from distributed import LocalCluster

from benchmarks.report import Row, parse, write_report
from trocar.envs.rollouts import Outcome, rollouts

NOTES = """Scenario `basic` (20 ms an action). Real time is simulated time over processor time of the steps, a core.
Published rates of others, of other work: CathSim 12 to 15 steps/s (rigid vessel, its 4 ms steps, images), as Seldinger
Lumen measured it; stEVE on SOFA 16 to 57; Lumen 62 to 120. LapGym publishes none. Here the duct deforms, two forceps
grasp with friction, and the training procedure judges each step; nothing is drawn.
"""


def _play(seeds: Sequence[int], **settings: object) -> tuple[list[Outcome], float]:
    began_s = time.perf_counter()
    found = list(rollouts(None, seeds, **settings))  # type: ignore[arg-type]
    return found, time.perf_counter() - began_s


def _real_time(found: Sequence[Outcome]) -> float:
    return sum(each.simulated_s for each in found) / sum(each.processor_s for each in found)


def main() -> None:
    """Measure and write the table."""
    n = parse(__doc__, episodes=(4, "of each row")).episodes
    _play([0])
    rows = []
    for name, quality, limit in (("steps of 2 ms, the default", 1, 5.0), ("steps of 1 ms", 0, None)):
        found, _ = _play(range(n), quality=quality)
        rows.append(Row(f"real time, {name}", _real_time(found), "x", limit, at_least=True))
    for jobs in (1, 2):
        _play(range(jobs), jobs=jobs)
        found, took_s = _play(range(2 * n), jobs=jobs)
        rows.append(Row(f"{jobs} process{'es' if jobs > 1 else ''}", sum(e.steps for e in found) / took_s, "steps/s"))
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        _play(range(4), scheduler=cluster.scheduler_address)
        found, took_s = _play(range(2 * n), scheduler=cluster.scheduler_address)
    rows.append(Row("local Dask cluster, 2 workers", sum(each.steps for each in found) / took_s, "steps/s"))
    write_report("envs", "Environments", rows, NOTES)


if __name__ == "__main__":
    main()
