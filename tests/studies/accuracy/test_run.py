"""A run: what is kept, what is computed again, where, and that it comes out the same."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
from conftest import SMALLEST

from trocar.studies.accuracy import costs, run
from trocar.studies.accuracy.costs import FLOOR, TIMED_IN_A_ROW, measure_costs
from trocar.studies.accuracy.frontier import frontier
from trocar.studies.accuracy.log import StudyLog
from trocar.studies.accuracy.study import Cost, Row, Setting


def row(setting, error, median_us, **kwargs):
    cost = None if median_us is None else Cost(median_us, 2.0 * median_us, 0.0)
    return Row("study", setting, "", "force", error, "%", cost=cost, **kwargs)


def test_two_runs_agree_on_errors(run_smallest, tmp_path):
    one, _ = run_smallest("integrator", folder=tmp_path / "one", costs=False)
    two, _ = run_smallest("integrator", folder=tmp_path / "two", costs=False)
    assert [r.error for r in one] == pytest.approx([r.error for r in two], abs=1e-9, rel=1e-9)


def test_what_a_folder_has_is_not_computed_again(run_smallest, tmp_path, monkeypatch):
    first, _ = run_smallest("integrator", folder=tmp_path / "log")
    lines = (tmp_path / "log" / "results.jsonl").read_text().splitlines()
    (tmp_path / "log" / "results.jsonl").write_text("\n".join(lines[1:]) + "\n")  # as if it had been ended earlier
    computed, compute = [], run.compute_errors
    monkeypatch.setattr(run, "compute_errors", lambda *args: computed.append(args[1]) or compute(*args))
    monkeypatch.setattr(run, "compute_reference", None)
    again, _ = run_smallest("integrator", folder=tmp_path / "log")
    assert computed == [0]
    assert again == first


class InGroups:
    """A study of two groups, of which one has nothing to be timed."""

    def __init__(self):
        self.prepared = []

    def settings(self, draw):
        return [Setting(name, {}, group=group) for name, group in (("a", "1"), ("b", "1"), ("c", "2"), ("d", "3"))]

    def tick(self, setting, draw):
        self.prepared.append(setting.name)
        return None if setting.name == "d" else lambda: None


def test_a_run_that_was_ended_between_groups_times_the_others_only(tmp_path, monkeypatch):
    first, second = InGroups(), InGroups()
    monkeypatch.setattr(run, "load_study", lambda name: first)
    run.fill_costs(["study"], SMALLEST, StudyLog(tmp_path, SMALLEST, "code"), lambda *_: None)
    file = tmp_path / "results.jsonl"
    lines = file.read_text().splitlines()
    assert len(lines) == 3
    file.write_text("\n".join(lines[:1]) + "\n")
    monkeypatch.setattr(run, "load_study", lambda name: second)
    log = StudyLog(tmp_path, SMALLEST, "code")
    run.fill_costs(["study"], SMALLEST, log, lambda *_: None)
    assert (first.prepared, second.prepared) == (["a", "b", "c", "d"], ["c", "d"])
    assert set(log.costs["study"]) == {"a", "b", "c", FLOOR}
    floors = [json.loads(line)["costs"][FLOOR]["median_us"] for line in file.read_text().splitlines() if FLOOR in line]
    assert log.costs["study"][FLOOR].median_us == max(floors)
    assert StudyLog(tmp_path, SMALLEST, "code").costs == log.costs


def test_a_folder_of_other_code_is_refused(tmp_path):
    StudyLog(tmp_path, SMALLEST, "code")
    with pytest.raises(ValueError, match="holds the results of"):
        StudyLog(tmp_path, SMALLEST, "other code")


def test_the_frontier_has_those_that_nobody_beats_in_both():
    rows = [row("slow", 1.0, 300.0), row("quick", 5.0, 100.0), row("worse", 6.0, 200.0), row("best", 0.5, 200.0)]
    assert [each.setting for each in frontier(rows)] == ["quick", "best"]
    unusable = [row("failed", float("nan"), 50.0), row("untimed", 0.1, None), row("change", 0.0, 10.0, is_known=False)]
    assert [each.setting for each in frontier(rows + unusable)] == ["quick", "best"]


def noisy(setting, error, median_us, noise_us):
    return replace(row(setting, error, median_us), cost=Cost(median_us, 2.0 * median_us, noise_us))


def test_who_is_more_wrong_and_cheaper_by_less_than_the_noise_is_beaten():
    rows = [noisy("poor", 5.0, 100.0, 3.0), noisy("fine", 1.0, 105.0, 3.0), noisy("finest", 0.5, 112.0, 3.0)]
    assert [each.setting for each in frontier(rows)] == ["fine", "finest"]
    assert [each.setting for each in frontier([*rows[:2], noisy("finest", 0.5, 110.9, 3.0)])] == ["finest"]
    assert [each.setting for each in frontier([replace(each, cost=Cost(100.0, 100.0, 3.0)) for each in rows])] == [
        "finest"
    ]


def test_errors_that_are_rounding_are_alike_and_the_cheapest_beyond_noise_is_left():
    rows = [noisy("exact", 1e-8, 120.0, 3.0), noisy("exact, too", 3e-7, 100.0, 3.0), noisy("as dear", 9e-5, 104.0, 3.0)]
    assert [each.setting for each in frontier(rows)] == ["exact, too", "as dear"]
    assert [each.setting for each in frontier([*rows, noisy("off", 2e-4, 90.0, 3.0)])] == [
        "off",
        "exact, too",
        "as dear",
    ]


def test_costs_are_measured_in_turns_with_the_floor_beside(monkeypatch):
    monkeypatch.setattr(costs, "getrusage", lambda _: SimpleNamespace(ru_nivcsw=0))  # a busy machine repeats ticks
    order = []
    found = measure_costs({"one": lambda: order.append(1), "two": lambda: order.append(2)}, 4 * TIMED_IN_A_ROW)
    assert set(found) == {"one", "two", FLOOR}
    turns = order[6 :: TIMED_IN_A_ROW + 1]  # after warming up; a third place in each round is the floor's
    assert turns == [1, 2, 2, 1, 1, 2, 1, 2]
    assert order[6:] == [who for who in turns for _ in range(TIMED_IN_A_ROW + 1)]


def test_a_tick_from_which_the_core_was_taken_is_timed_again(monkeypatch):
    now_ns, switches, taken = [0], [0], iter([False, True, True] + [False] * 1000)

    def tick():
        now_ns[0] += 1_000
        if next(taken):
            now_ns[0] += 4_000_000
            switches[0] += 1

    monkeypatch.setattr(costs, "perf_counter_ns", lambda: now_ns[0])
    monkeypatch.setattr(costs, "getrusage", lambda _: SimpleNamespace(ru_nivcsw=switches[0]))
    assert [costs._time_us(tick) for _ in range(3)] == [1.0, 1.0, 1.0]
    taken = iter([True] * 1000)
    assert costs._time_us(tick) == 4_001.0, "what is always disturbed is told as it is"


def test_what_others_have_pushed_out_of_the_caches_is_not_in_a_cost(monkeypatch):
    """Each takes a microsecond, and a thousand where another has run before it."""
    now_ns, last = [0], [""]

    def tick(name):
        now_ns[0] += 1_000 if last[0] == name else 1_000_000
        last[0] = name

    monkeypatch.setattr(costs, "perf_counter_ns", lambda: now_ns[0])
    monkeypatch.setattr(costs, "_floor_tick", lambda: lambda: tick(FLOOR))
    found = measure_costs({"one": lambda: tick("one"), "two": lambda: tick("two")}, 20)
    assert set(found.values()) == {Cost(1.0, 1.0, 0.0)}


def test_a_cluster_of_processes_computes_the_same(run_smallest, tmp_path):
    from distributed import LocalCluster

    here, _ = run_smallest("integrator", folder=tmp_path / "here", costs=False)
    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", host="127.0.0.1"
    ) as cluster:
        there, _ = run_smallest(
            "integrator", folder=tmp_path / "there", costs=False, scheduler=cluster.scheduler_address
        )
    assert [r.setting for r in there] == [r.setting for r in here]
    assert [r.error for r in there] == pytest.approx([r.error for r in here], abs=1e-9, rel=1e-9)


def test_a_scheduler_that_is_not_there_is_one_sentence(run_smallest, monkeypatch):
    from trocar.studies.accuracy import workers

    monkeypatch.setattr(workers, "CONNECT_S", 0.5)
    with pytest.raises(ConnectionError, match=r"127\.0\.0\.1:1"):
        run_smallest("integrator", costs=False, scheduler="tcp://127.0.0.1:1")
