"""Environments: speed of `trocar/Insertion-v0` with an expert's hands, alone, in processes, on a local Dask cluster.

    python -m benchmarks.bench_envs [--episodes 4]

Processor time of a simulated second is the figure that a busy machine leaves alone; steps a second are by the clock.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from distributed import LocalCluster

from benchmarks.report import Row, parse, write_report
from trocar.envs.rollouts import Outcome, play
from trocar.studies.accuracy.workers import open_workers

NOTES = """Scenario `basic` (20 ms an action), an expert's hands. Real time is simulated time over processor time of the
steps, a core; the expert's thinking is not in it. Rates are by the clock, of {rated} episodes each, once workers have
imported and built; two threads of one core are no two cores. Of other work: CathSim 12 to 15 steps/s (rigid vessel,
its 4 ms steps, images), as Seldinger Lumen measured it; stEVE on SOFA 16 to 57; Lumen 62 to 120. LapGym publishes none.
Here the duct deforms, two forceps grasp with friction, and the training procedure judges each step; nothing is drawn.
"""


def _call(seed: int, **settings: object) -> tuple[object, ...]:
    return None, seed, 0.0, ("trocar/Insertion-v0", tuple(settings.items()))


def _real_time(found: Sequence[Outcome]) -> float:
    return sum(each.simulated_s for each in found) / sum(each.processor_s for each in found)


def _rate(name: str, n: int, jobs: int, scheduler: str | None = None) -> Row:
    """Return how many steps workers take in a second."""
    with open_workers(jobs, scheduler) as workers:
        list(workers.run(play, [_call(seed) for seed in range(2 * jobs)]))  # each has an environment then
        began_s = time.perf_counter()
        found = [outcome for _, outcome in workers.run(play, [_call(seed) for seed in range(n)])]
        took_s = time.perf_counter() - began_s
    return Row(name, sum(each.steps for each in found) / took_s, "steps/s")


def main() -> None:
    """Measure and write the table."""
    n = parse(__doc__, episodes=(4, "of each row")).episodes
    rows = []
    for name, quality, limit in (("steps of 2 ms, the default", 1, 5.0), ("steps of 1 ms", 0, None)):
        play(*_call(0, quality=quality))  # type: ignore[arg-type]
        found = [play(*_call(seed, quality=quality)) for seed in range(n)]  # type: ignore[arg-type]
        rows.append(Row(f"real time, {name}", _real_time(found), "x", limit, at_least=True))
    rows += [_rate("1 process", 2 * n, 1), _rate("2 processes", 2 * n, 2)]
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        rows.append(_rate("local Dask cluster, 2 workers", 2 * n, 2, cluster.scheduler_address))
    write_report("envs", "Environments", rows, NOTES.format(rated=2 * n))


if __name__ == "__main__":
    main()
