"""What `deploy/check-compose` judges at half of the machine's speed: rates by ticks and ages that the metrics say."""

from __future__ import annotations

import itertools
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import prometheus_client
import pytest

from benchmarks import bare_loop
from deploy import judge_rates
from deploy.judge_rates import LOOPS, SETTLED_S, Counted, count, faults, main, rates, settled, take
from tests.monitoring.exporter import whole_rig
from trocar.services.supervisor.page.metrics import registry

ROOT = Path(__file__).resolve().parents[2]
BARE = {"mean_hz": 999.9, "worst_hz": 999.0}


def _metrics(age_s: float, ticks: dict[str, float]) -> str:
    rows = [f'trocar_service_uptime_seconds{{service="{name}"}} {age_s}' for name in (*LOOPS, "recorder")]
    return "\n".join([*rows, *(f'trocar_loop_iterations_total{{loop="{name}"}} {n}' for name, n in ticks.items()), ""])


def _counted(second_hz: list[float], from_s: float = 20.0) -> Counted:
    """Return what is read five times a second of a loop that runs at these rates, a second each."""
    done = [0.0, *itertools.accumulate(hz / 5.0 for hz in second_hz for _ in range(5))]
    return [(from_s + k / 5.0, ticks) for k, ticks in enumerate(done)]


def _faults(second_hz: list[float], floor: dict[str, float] = BARE) -> list[str]:
    return faults({"physics": _counted(second_hz)}, floor)


def test_the_mean_and_the_worst_second_are_judged() -> None:
    assert rates(_counted([1000.0, 985.0, 1000.0])) == pytest.approx((995.0, 985.0))
    assert _faults([1000.0, 985.0, 1000.0]) == []
    assert _faults([1000.0, 970.0, *[1000.0] * 8]) == ["physics: 997.0 Hz, worst second 970.0; asked: 995.0, 980.0"]
    assert _faults([994.0] * 10) == ["physics: 994.0 Hz, worst second 994.0; asked: 995.0, 980.0"]


def test_no_more_is_asked_than_a_bare_loop_had() -> None:
    assert _faults([994.0, 970.0], {"mean_hz": 980.0, "worst_hz": 960.0}) == []
    assert _faults([994.0, 950.0], {"mean_hz": 970.0, "worst_hz": 960.0}) != []


def test_only_the_present_life_of_a_loop_counts_once_it_has_settled() -> None:
    counted: dict[str, Counted] = {name: [] for name in LOOPS}
    for age_s, ticks in ((90.0, 9e4), (90.0, 9e4), (0.5, 100.0), (SETTLED_S + 1.0, 8e3), (SETTLED_S + 2.0, 9e3)):
        take(_metrics(age_s, dict.fromkeys(LOOPS, ticks)), counted)
    assert settled(counted["physics"]) == [(SETTLED_S + 1.0, 8e3), (SETTLED_S + 2.0, 9e3)]
    take("", counted)  # the page was busy
    assert len(counted["physics"]) == 3


def test_what_was_ended_before_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last report stands in the metrics until the next life speaks."""
    clock_s = itertools.count(0.0, 10.0)
    monkeypatch.setattr(judge_rates.time, "monotonic", lambda: next(clock_s))
    monkeypatch.setattr(judge_rates.time, "sleep", lambda _s: None)
    with pytest.raises(SystemExit, match="not every loop ran for 15 s"):
        count(lambda: _metrics(90.0, dict.fromkeys(LOOPS, 9e4)), 15.0)


def test_it_reads_what_the_exporter_says() -> None:
    counted: dict[str, Counted] = {name: [] for name in LOOPS}
    take(prometheus_client.generate_latest(registry(whole_rig, "summary")).decode(), counted)
    assert all(len(seen) == 1 for seen in counted.values())


@pytest.mark.parametrize(("slow_hz", "code"), [(1000.0, 0), (990.0, 1)])
def test_the_whole_of_it_ends_with_a_code(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    slow_hz: float,
    code: int,
) -> None:
    def pages() -> Iterator[str]:
        for k in itertools.count(1):
            yield _metrics(k / 5.0, {"gateway": 200.0 * k, "haptics": 200.0 * k, "physics": slow_hz * k / 5.0})

    text = pages()
    monkeypatch.setattr(judge_rates, "read_from", lambda _address: next(text))
    monkeypatch.setattr(judge_rates.time, "sleep", lambda _s: None)
    (tmp_path / "floor").write_text(json.dumps(bare_loop.of_seconds([0.0, 0.1])))
    assert main("http://127.0.0.1/metrics", "15", str(tmp_path / "floor")) == code
    said = capsys.readouterr()
    assert "a bare loop beside them: 999.5 Hz, worst second 999.0" in said.out
    assert ("physics: 990.0 Hz, worst second 990.0; asked: 995.0, 980.0" in said.err) is bool(code)


def test_the_script_is_one_that_the_shell_reads() -> None:
    subprocess.run(["bash", "-n", str(ROOT / "deploy" / "check-compose")], check=True)
