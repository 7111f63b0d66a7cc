"""The suite itself: its members, its log, its order."""

from dataclasses import asdict, replace

import pytest

from trocar.studies.stability.families import FAMILIES
from trocar.studies.stability.family import Draw, Reach
from trocar.studies.stability.report import changes, page
from trocar.studies.stability.suite import Log, Order, Result, by_turns, list_cases, run_suite

LONG = Order(Reach.LONG, 1, tuple(FAMILIES))
THEORY = Order(Reach.QUICK, 1, ("theory",))


def test_the_long_suite_has_at_least_2000_cases_and_500_jerks_with_names_of_their_own():
    cases = list_cases(LONG)
    assert len(cases) == len(set(cases)) >= 2000
    assert sum(family == "jerks" for family, _ in cases) >= 500
    assert {family for family, _ in cases} == set(FAMILIES)


def test_the_quick_suite_takes_members_of_every_family():
    assert {family for family, _ in list_cases(Order(Reach.QUICK, 1, tuple(FAMILIES)))} == set(FAMILIES)


def test_a_case_is_drawn_from_the_seed_and_its_name():
    draw = Draw(Reach.LONG, 3)
    assert draw.random("one").random() == draw.random("one").random()
    assert draw.random("one").random() != draw.random("other").random()
    assert draw.random("one").random() != Draw(Reach.LONG, 4).random("one").random()


def test_what_the_log_has_is_not_run_again(tmp_path):
    told = []
    first = run_suite(THEORY, 1, Log(tmp_path, THEORY, "code"), lambda *args: told.append(args))
    assert len(told) == len(first) == len(list_cases(THEORY))
    again = run_suite(THEORY, 1, Log(tmp_path, THEORY, "code"), lambda *args: told.append(args))
    assert len(told) == len(first)
    assert again == first


def test_no_case_is_begun_when_time_is_up_and_the_next_run_goes_on(tmp_path):
    log = Log(tmp_path, THEORY, "code")
    assert len(run_suite(THEORY, 1, log, lambda *_: None, 0.0)) == 1
    assert len(run_suite(THEORY, 1, log, lambda *_: None)) == len(list_cases(THEORY))


def test_a_log_of_another_order_is_refused(tmp_path):
    Log(tmp_path, THEORY, "code")
    with pytest.raises(ValueError, match="holds the results of"):
        Log(tmp_path, THEORY, "other code")


def test_the_page_names_what_failed_and_the_worst_of_each_criterion():
    results = [
        Result("theory", "good", {"theory": 0.0, "rest": 1.0}, 10, 0.1),
        Result("theory", "bad", {"theory": 1.0, "rest": float("inf")}, 10, 0.1),
    ]
    written = page(THEORY, results, "abc")
    assert f"Written by `trocar stability --quick --family theory --seed {THEORY.seed}`" in written
    assert "2 of 4 cases run, 1 failed**: 1.26 to 98.7 % of such cases fail" in written
    assert "No failure in 2 cases, the most of a family, still means a rate of 0 to 84.2 %." in written
    assert "| theory | rest (1, never), theory (1, 1) |" in written
    assert "| rest | 2 s | never | theory: bad | 2 | 1 |" in written
    both = page(THEORY, results, "abc", {7: results[:1]})
    assert "3 of 8 cases run, 1 failed" in both
    assert f"code abc, seeds {THEORY.seed}, 7, " in both


def test_two_runs_are_compared_case_by_case():
    before = [
        asdict(Result("theory", name, {"rest": rest}, 1, 0.0))
        for name, rest in zip("abc", (1.0, 3.0, 3.0), strict=True)
    ]
    now = [Result("theory", name, {"rest": rest}, 1, 0.0) for name, rest in zip("abd", (3.0, 1.0, 3.0), strict=True)]
    told = changes(before, now)
    assert told.startswith("2 cases in both runs: 1 failed then, 1 now\n")
    assert told.splitlines()[1:] == ["theory: a: passed -> rest", "theory: b: rest -> passes"]


def test_so_many_of_each_family_are_drawn_by_the_seed_and_take_turns():
    order = Order(Reach.LONG, 5, ("jerks", "vanishing", "undamped"), 3)
    cases = list_cases(order)
    assert [family for family, _ in cases] == ["jerks"] * 3 + ["vanishing"] * 3 + ["undamped"] * 3
    assert cases == list_cases(order)
    assert set(cases) < set(list_cases(replace(order, most=None)))
    assert cases != list_cases(replace(order, seed=6))
    turns = [family for family, _ in by_turns(cases, 5)]
    assert all(set(turns[k : k + 2]) == {"jerks", "vanishing"} for k in (0, 2, 4))
    assert turns[6:] == ["undamped"] * 3


def test_a_heal_fails_a_case_but_where_the_family_is_made_for_it():
    assert [name for name, family in FAMILIES.items() if family.may_heal] == ["numbers"]
    assert Result("jerks", "one", {"healed": 1.0, "dropped": 1.0}, 1, 0.0).failed == ["healed", "dropped"]
    assert Result("numbers", "one", {"healed_by_design": 1.0}, 1, 0.0).failed == []
