"""What each rung of the quality ladder lost in a run."""

from __future__ import annotations

import pickle

from tests.supervisor.made_up import health, loop_report
from trocar.services.supervisor.run_counts import RunCounts


def report(name, uptime_s, ticks, misses, pid=7):
    return health(name, uptime_s=uptime_s, loop=loop_report(ticks, misses), pid=pid)


def test_each_rung_has_what_was_lost_while_it_was_in_force():
    counts = RunCounts()
    counts.begin_counting([report("physics", 1.0, 1000, 500), report("gateway", 1.0, 1000, 0)])
    counts.record_level(10.0, 0, "full")
    counts.add(report("physics", 2.0, 2000, 700))
    counts.add(report("gateway", 2.0, 2000, 1))
    counts.record_level(11.0, 1, "coarse")
    counts.add(report("physics", 5.0, 5000, 703))
    counts.record_level(14.0, 1, "coarse")
    first, second = counts.rungs()
    assert (first["level"], first["name"], first["start_s"], first["seconds"]) == (0, "full", 0.0, 1.0)
    assert first["loops"]["physics"] == {"ticks": 1000, "misses": 200, "skipped": 0}
    assert first["loops"]["gateway"]["misses"] == 1
    assert (second["level"], second["name"], second["start_s"], second["seconds"]) == (1, "coarse", 1.0, 3.0)
    assert second["loops"]["physics"] == {"ticks": 3000, "misses": 3, "skipped": 0}
    assert second["loops"]["gateway"]["misses"] == 0


def test_a_rung_taken_again_is_another_interval_and_a_process_born_anew_goes_on_counting():
    counts = RunCounts()
    counts.begin_counting([report("physics", 9.0, 9000, 40)])
    for level, uptime_s, pid in ((0, 10.0, 7), (1, 1.0, 8), (0, 2.0, 8)):
        counts.record_level(float(len(counts.rungs())), level, f"rung {level}")
        counts.add(report("physics", uptime_s, round(1000 * uptime_s), 4 * round(uptime_s), pid))
    assert [(each["level"], each["loops"]["physics"]["ticks"]) for each in counts.rungs()] == [
        (0, 1000),
        (1, 1000),
        (0, 1000),
    ]


def test_a_run_that_never_settled_has_no_intervals():
    assert RunCounts().rungs() == []


def test_a_rung_that_is_over_keeps_no_histograms():
    counts = RunCounts()
    counts.begin_counting([report("physics", 1.0, 1000, 500)])
    sizes = []
    for k in range(40):
        counts.record_level(float(k), k % 2, "coarse" if k % 2 else "full")
        counts.add(report("physics", 2.0 + k, 2000 + 1000 * k, 500))
        sizes.append(len(pickle.dumps(counts)))
    assert (sizes[-1] - sizes[9]) / 30 < 200
