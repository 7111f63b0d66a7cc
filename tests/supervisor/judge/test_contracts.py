"""Contracts on synthetic counts: limits, sentences, hysteresis."""

from __future__ import annotations

import pytest

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import health, histogram, loop_report
from trocar.services.runtime.config.rig import Contracts
from trocar.services.supervisor.judge import figures
from trocar.services.supervisor.judge.contracts import Breach, Standing, judge, path_limits_us, spent_s
from trocar.services.supervisor.judge.window import Window

BUDGET = Contracts.model_validate({"loops": {"physics": {"rate_hz": 1000, "miss_ratio": 0.001}}})
PATHS = Contracts.model_validate({"paths": {"device_model": {"p99_us": 800, "stop_p99_us": 20000}}})


class Watched:
    """The window of a loop of 1 kHz that reports ten times a second."""

    def __init__(self) -> None:
        self.window = Window(60.0)
        self.seconds = 0.0
        self.ticks = self.misses = self.skipped = self.beyond = 0

    def run(self, seconds: float, late: int = 0, skipped: int = 0, beyond: int = 0) -> list[Breach]:
        """Go on, of each tenth of a second so many ticks late, and so many that never ran; return the last word."""
        found: list[Breach] = []
        for _ in range(round(10 * seconds)):
            self.seconds += 0.1
            self.ticks += 100 - skipped
            self.misses += late + skipped
            self.skipped += skipped
            self.beyond += beyond
            loop = loop_report(self.ticks, self.misses, self.skipped, beyond_work=self.beyond)
            self.window.add(7, figures.of(health("physics", uptime_s=self.seconds, loop=loop)))
            found = judge({"physics": self.window}, BUDGET)
        return found


def test_a_tick_lost_now_and_then_is_what_the_budget_is_for() -> None:
    watched = Watched()
    for _ in range(60):
        assert watched.run(0.9) == []
        assert watched.run(0.1, late=1) == []


@pytest.mark.parametrize("kind", ["late", "skipped"])
def test_a_stall_within_the_budget_breaks_nothing(kind: str) -> None:
    watched = Watched()
    watched.run(30.0)
    assert watched.run(0.1, **{kind: 45}) == []
    assert watched.run(10.0) == []


def test_an_overdrawn_budget_is_told_while_it_is_being_overdrawn() -> None:
    watched = Watched()
    watched.run(20.0)
    assert watched.run(3.0, late=2) == []  # 60 lost: the budget of a minute
    (breach,) = watched.run(0.1, late=1)
    assert breach.text == "physics: 61 ticks lost in the last minute, budget 60"
    assert breach.key == "physics ticks"
    assert not breach.severe
    assert watched.run(6.0) == [], "five seconds without a loss: it is over, though the minute's budget is spent"
    assert watched.run(0.2, late=3) != []


@pytest.mark.parametrize(("beyond", "by_work"), [(30, False), (2, True)])
def test_a_breach_says_whether_less_work_would_have_kept_the_contract(beyond: int, by_work: bool) -> None:
    watched = Watched()
    watched.run(20.0)
    (breach,) = watched.run(1.0, late=2, skipped=28, beyond=beyond)
    assert breach.by_work is by_work
    spent = spent_s({"physics": watched.window}, BUDGET, [breach])
    assert spent == pytest.approx(10 * (30 - beyond), rel=0.02), "of the budget of a tick in a thousand"


def test_a_stall_makes_nothing_sudden_of_what_work_has_lost_before() -> None:
    """Six ticks that work lost beside each stall overdrew the minute; the next stall of 50 ms made that a breakdown."""
    watched = Watched()
    watched.run(20.0)
    for _ in range(10):
        watched.run(0.1, skipped=53, beyond=47)
        watched.run(1.4)
    (breach,) = watched.run(0.1, skipped=53, beyond=47)
    assert breach.by_work
    assert not breach.sudden
    assert breach.text == "physics: 66 ticks lost in the last minute, budget 60"


def test_a_loop_that_runs_too_seldom_loses_ticks_even_where_it_counts_none() -> None:
    watched = Watched()
    watched.run(5.0)
    for _ in range(30):
        watched.seconds += 0.1
        watched.ticks += 90
        loop = loop_report(watched.ticks, 0, 0)
        watched.window.add(7, figures.of(health("physics", uptime_s=watched.seconds, loop=loop)))
    (breach,) = judge({"physics": watched.window}, BUDGET)
    assert "ticks lost" in breach.text


def test_a_budget_that_is_spent_within_seconds_is_sudden_and_one_that_seeps_away_is_not() -> None:
    watched = Watched()
    watched.run(20.0)
    for _ in range(3):
        watched.run(0.1, skipped=51)  # as where the kernel stops real-time threads for the rest of each second
        found = watched.run(0.9)
    assert [breach.sudden for breach in found] == [True]
    seeping = Watched()
    seeping.run(20.0)
    assert [breach.sudden for breach in seeping.run(8.0, late=1)] == [False]


def test_a_stall_that_spends_the_budget_is_sudden_for_a_second_only() -> None:
    watched = Watched()
    watched.run(20.0)
    (breach,) = watched.run(0.1, skipped=90)
    assert breach.sudden
    (breach,) = watched.run(1.2)
    assert not breach.sudden


def test_a_breakdown_is_told_within_three_reports() -> None:
    watched = Watched()
    watched.run(60.0)
    (breach,) = watched.run(0.3, late=40)
    assert breach.text == "physics: 12.0 % of the ticks lost over 1.0 s, limit 5.0 %"
    assert not breach.severe
    (worse,) = watched.run(2.0, late=60)
    assert worse.severe


def test_two_bad_tenths_of_a_second_that_are_over_are_no_breakdown() -> None:
    watched = Watched()
    watched.run(60.0)
    watched.run(0.1, late=55)
    assert watched.run(0.3) == []


def test_a_restarted_process_has_a_budget_of_its_own() -> None:
    watched = Watched()
    watched.run(5.0, late=10)
    watched.seconds, watched.ticks, watched.misses = 0.0, 0, 0
    assert watched.run(5.0) == []


def test_a_process_that_is_not_heard_is_not_judged() -> None:
    assert judge({}, BUDGET) == []
    window = Window(60.0)
    for seconds in (1.0, 1.1):
        window.add(7, figures.of(health("physics", uptime_s=seconds)))
    assert judge({"physics": window}, BUDGET) == []


def _path(name: str, *batches: list[int]) -> dict[str, Window]:
    """A second between batches of durations in microseconds."""
    window, so_far = Window(60.0), []
    for k, batch in enumerate([[], *batches]):
        so_far += [d * 1000 for d in batch]
        paths = (bodies.PathLatency(name=name, latency=histogram(so_far)),)
        window.add(7, figures.of(health("gateway", uptime_s=1.0 + k, paths=paths)))
    return {"gateway": window}


def test_path() -> None:
    assert judge(_path("device_model", [300] * 995 + [900] * 5), PATHS) == []
    (breach,) = judge(_path("device_model", [300] * 900 + [900] * 100), PATHS)
    assert breach.process == "haptics"  # reported by the gateway, decided by haptics
    assert breach.text.startswith("path device_model: p99 ")
    assert breach.text.endswith("limit 800 us")
    assert not breach.severe
    (severe,) = judge(_path("device_model", [30000] * 200), PATHS)
    assert severe.severe


def test_a_path_that_was_slow_and_is_not_any_more_keeps_its_contract() -> None:
    slow, quick = [300] * 900 + [900] * 100, [300] * 1000
    assert judge(_path("device_model", slow, *[quick] * 3), PATHS) != []
    assert judge(_path("device_model", slow, *[quick] * 6), PATHS) == []


def test_few_samples_have_no_99th_percentile() -> None:
    assert judge(_path("device_model", [5000] * 99), PATHS) == []
    assert judge(_path("device_model", [5000] * 100), PATHS) != []


def _breach(key: str = "a", excess: float = 2.0) -> Breach:
    return Breach("physics", key, f"{key} {excess}", excess, False)


def test_a_breach_stands_only_after_a_while_and_leaves_only_after_a_while() -> None:
    standing = Standing(enter_s=0.2, leave_s=1.0)
    assert standing.update(0.0, [_breach()]) == []
    assert standing.update(0.1, [_breach()]) == []
    assert len(standing.update(0.2, [_breach()])) == 1
    assert len(standing.update(1.0, [])) == 1
    assert standing.update(1.2, []) == []
    assert standing.update(1.3, [_breach()]) == []  # it begins anew


def test_a_flicker_never_stands() -> None:
    standing = Standing(enter_s=0.2, leave_s=0.3)
    for k in range(40):
        seen = [_breach()] if k % 5 == 0 else []
        assert standing.update(k * 0.1, seen) == []


def test_worst_first_with_the_newest_figures() -> None:
    standing = Standing(enter_s=0.0, leave_s=1.0)
    standing.update(0.0, [_breach("a", 2.0), _breach("b", 3.0)])
    found = standing.update(0.1, [_breach("a", 9.0)])
    assert [breach.text for breach in found] == ["a 9.0", "b 3.0"]


def test_a_loop_that_follows_its_readers_owes_what_they_ask_for_and_no_other_loop_does() -> None:
    """36 pictures a second for 20 s, then 15, then 36 again: nothing is lost on the way, unless it is lost."""
    for follows in (True, False):
        contract = {"rate_hz": 30, "miss_ratio": 0.01, "follows_readers": follows}
        contracts = Contracts.model_validate({"loops": {"visualization": contract}})
        window, seconds, ticks, misses = Window(60.0), 0.0, 0.0, 0
        found: dict[str, list[Breach]] = {}
        for phase, rate_hz, late in (("all", 36, 0), ("few", 15, 0), ("all again", 36, 0), ("few, late", 15, 1)):
            for _ in range(200):
                seconds += 0.1
                ticks += rate_hz / 10
                misses += late
                loop = loop_report(int(ticks), misses, rate_hz=rate_hz)
                window.add(7, figures.of(health("visualization", uptime_s=seconds, loop=loop)))
                found.setdefault(phase, []).extend(judge({"visualization": window}, contracts))
        assert found["all"] == []
        assert (found["few"] == []) == follows
        assert found["all again"] == []
        assert found["few, late"]


def test_no_more_is_lost_than_there_was() -> None:
    """A picture runs at 36 Hz where 30 must be kept: a stall of three seconds was "125.7 % of the ticks lost"."""
    assert told_of_a_picture(121) == "visualization: 98.9 % of the ticks lost over 3.4 s, limit 50.0 %"
    # One that began before the window is counted when it ends.
    assert told_of_a_picture(180) == "visualization: 100.0 % of the ticks lost over 3.4 s, limit 50.0 %"


def told_of_a_picture(missed: int) -> str:
    contracts = Contracts.model_validate({"loops": {"visualization": {"rate_hz": 30, "miss_ratio": 0.01}}})
    window = Window(60.0)
    for uptime_s, ticks, misses in ((1.0, 36, 0), (4.0, 36, 0), (4.1, 37, missed - 10), (4.4, 38, missed)):
        loop = loop_report(ticks, misses, misses, rate_hz=36)
        window.add(7, figures.of(health("visualization", uptime_s=uptime_s, loop=loop)))
    (breach,) = judge({"visualization": window}, contracts)
    return breach.text


@pytest.mark.parametrize(("asked_hz", "keeps"), [(36.0, False), (30.0, False), (10.0, True)])
def test_a_picture_may_come_later_where_fewer_are_asked_for(asked_hz: float, *, keeps: bool) -> None:
    loops = {"visualization": {"rate_hz": 30, "miss_ratio": 0.01, "follows_readers": True}}
    contracts = Contracts.model_validate({"loops": loops, "paths": {"device_pixel": {"p99_us": 60000}}})
    window, late_ns = Window(60.0), []
    for second in range(8):
        late_ns += [100_000_000] * 30
        paths = (bodies.PathLatency(name="device_pixel", latency=histogram(late_ns)),)
        loop = loop_report(int(asked_hz * second), 0, rate_hz=asked_hz)
        window.add(7, figures.of(health("visualization", uptime_s=1.0 + second, loop=loop, paths=paths)))
    found = judge({"visualization": window}, contracts)
    assert (found == []) == keeps
    shown = path_limits_us({"visualization": window}, contracts)
    assert shown == {"device_pixel": pytest.approx(60000 * max(1.0, 30 / asked_hz))}, "it is shown what it is judged by"
