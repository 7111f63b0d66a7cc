"""Contracts on synthetic counts: limits, sentences, hysteresis."""

from __future__ import annotations

import pytest

import protocol.bodies as bodies
from services.runtime.rig import Contracts
from services.supervisor import figures
from services.supervisor.contracts import Breach, Standing, judge
from tests.supervisor.made_up import health, histogram, loop_report


def _figures(process: str, loop: bodies.LoopReport | None, seconds: float = 2.0) -> dict[str, figures.Figures]:
    return {process: figures.of(health(process, uptime_s=seconds, loop=loop))}


def _path(name: str, durations_us: list[int]) -> dict[str, figures.Figures]:
    latency = histogram([d * 1000 for d in durations_us])
    return {"gateway": figures.of(health("gateway", paths=(bodies.PathLatency(name=name, latency=latency),)))}


LOOPS = Contracts.model_validate({"loops": {"physics": {"rate_hz": 1000, "miss_ratio": 0.01}}})
PATHS = Contracts.model_validate({"paths": {"device_model": {"p99_us": 800, "stop_p99_us": 20000}}})


@pytest.mark.parametrize(
    ("ticks", "misses", "skipped", "keys"),
    [
        (2000, 0, 0, []),
        (2000, 20, 0, []),  # exactly at the limit is kept
        (2000, 21, 0, ["physics misses"]),
        (1980, 20, 20, []),  # skipped ticks are missed ticks
        (1900, 100, 100, ["physics misses", "physics rate"]),
        (1979, 0, 0, []),  # one tick is the resolution of a count
        (1978, 0, 0, ["physics rate"]),
    ],
)
def test_loop(ticks: int, misses: int, skipped: int, keys: list[str]) -> None:
    found = judge(_figures("physics", loop_report(ticks, misses, skipped)), LOOPS)
    assert [breach.key for breach in found] == keys


def test_the_sentence_names_process_value_and_limit() -> None:
    (breach,) = judge(_figures("physics", loop_report(2000, 50)), LOOPS)
    assert breach.text == "physics: 2.50 % of the ticks missed over 2.0 s, limit 1.00 %"
    assert breach.excess == pytest.approx(2.5)
    assert not breach.severe


def test_half_of_all_ticks_missed_is_severe() -> None:
    found = judge(_figures("physics", loop_report(2000, 1100)), LOOPS)
    assert [breach.severe for breach in found] == [True]


def test_a_process_that_is_not_heard_is_not_judged() -> None:
    assert judge({}, LOOPS) == []
    assert judge(_figures("physics", None), LOOPS) == []


def test_path() -> None:
    assert judge(_path("device_model", [300] * 995 + [900] * 5), PATHS) == []
    (breach,) = judge(_path("device_model", [300] * 900 + [900] * 100), PATHS)
    assert breach.process == "haptics"  # reported by the gateway, decided by haptics
    assert breach.text.startswith("path device_model: p99 ")
    assert breach.text.endswith("limit 800 us")
    assert not breach.severe
    (severe,) = judge(_path("device_model", [30000] * 200), PATHS)
    assert severe.severe


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
