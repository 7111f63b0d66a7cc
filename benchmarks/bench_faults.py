"""Kills and freezes of gateway, haptics and physics at random: how the hand fares, and how the rig comes back.

    python benchmarks/bench_faults.py [--faults 200] [--seed 14]

A rig whose left hand presses on the duct, SIGKILL or SIGSTOP of one of the three at a random moment, then: how long
until the rig works again (RUNNING, or DEGRADED where a budget of the last minute is spent: forces are on in both),
whether a force ever stepped by more than the rate limit, and how fast each loop runs between the fifth and the seventh
second after that. Exit status 1 if any of it fails.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from report import Row, write_report

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests' rig is launched as a user would

from tests.rig.conftest import HERE, SCENE, Rig, running_rig
from tests.rig.faults import engage, force_rates_n_s, rate_limit_n_s

LOOPS = ("gateway", "haptics", "physics")
SIGNALS = (signal.SIGKILL, signal.SIGSTOP)
BACK_S, SETTLED_S, MEASURED_S, SLOWEST_HZ = 60.0, 5.0, 2.0, 990.0


@dataclass(frozen=True)
class Outcome:
    """Of one fault."""

    process: str
    signal: str
    working_again_s: float
    state: str  # of the rig at the end
    fastest_n_s: float
    rates_hz: dict[str, float]

    def failures(self) -> list[str]:
        """Return what went wrong, a sentence each."""
        found = [] if self.working_again_s < BACK_S else [f"does not work within {BACK_S:g} s"]
        if self.fastest_n_s > rate_limit_n_s():
            found.append(f"a force that changed by {self.fastest_n_s:.1f} N/s")
        return found + [f"{name} at {hz:.0f} Hz" for name, hz in self.rates_hz.items() if not hz >= SLOWEST_HZ]


def _ticks(rig: Rig, seconds: float) -> dict[str, list[tuple[int, int]]]:
    """Watch for `seconds`; return when each loop had done how many ticks."""
    seen: dict[str, list[tuple[int, int]]] = {name: [] for name in LOOPS}
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        time.sleep(0.02)
        rig.observer.look()
        for name in LOOPS:
            frames = rig.observer.bus.drain(f"{name}.health")
            seen[name] += [(each.sent_ns, each.body.loop.ticks) for each in frames if each.body.loop is not None]
    return seen


def _rate_hz(seen: list[tuple[int, int]]) -> float:
    if len(seen) < 2:
        return 0.0
    (first_ns, first), (last_ns, last) = seen[0], seen[-1]
    return 1e9 * (last - first) / (last_ns - first_ns)


def strike(rig: Rig, process: str, number: signal.Signals, after_s: float) -> Outcome:
    """Strike `process` while the hand feels something, and watch."""
    observer = rig.observer
    engage(rig)
    _ticks(rig, after_s)
    struck, pid = time.monotonic(), observer.pids()[process]
    os.kill(pid, number)
    said = len(observer.states)
    try:
        observer.until(lambda: observer.pids()[process] not in (0, pid), BACK_S, f"{process} replaced")
        observer.until(lambda: _works(rig, said), BACK_S, "working again")
    except AssertionError as error:
        print(error, file=sys.stderr)
    again_s = time.monotonic() - struck
    _ticks(rig, SETTLED_S)
    seen = _ticks(rig, MEASURED_S)
    rates_n_s = force_rates_n_s(observer.samples)
    rates_hz = {name: _rate_hz(seen[name]) for name in LOOPS}
    return Outcome(process, number.name, again_s, observer.rig_state, max(rates_n_s, default=0.0), rates_hz)


def _works(rig: Rig, said: int) -> bool:
    """Return whether the rig works, by what its supervisor says after having said `said`."""
    observer = rig.observer
    reports = {name: observer.report(name) for name in LOOPS}
    is_up = observer.rig_state in ("running", "degraded") and len(observer.states) > said
    return is_up and set(reports.values()) == {"ready"}


def _rows(outcomes: list[Outcome]) -> list[Row]:
    rows = [
        Row("fastest change of force from tick to tick", max(o.fastest_n_s for o in outcomes), "N/s", rate_limit_n_s())
    ]
    for process in LOOPS:
        for number in SIGNALS:
            some = [o for o in outcomes if (o.process, o.signal) == (process, number.name)]
            if some:
                seconds = np.array([o.working_again_s for o in some])
                name = f"{process}, {number.name}: working again (of {len(some)})"
                rows.append(Row(name, float(np.median(seconds)), "s", BACK_S, p99=float(seconds.max())))
    for loop in LOOPS:
        rates = np.array([o.rates_hz[loop] for o in outcomes])
        name = f"{loop}: slowest five seconds later"
        rows.append(
            Row(name, float(rates.min()), "Hz", SLOWEST_HZ, at_least=True, extra={"p50": float(np.median(rates))})
        )
    running = sum(o.state == "running" for o in outcomes)
    rows.append(Row("RUNNING at the end of those", 100.0 * running / len(outcomes), "%"))
    failed = sum(bool(o.failures()) for o in outcomes)
    return [*rows, Row(f"faults after which something failed, of {len(outcomes)}", float(failed), "", 0.0)]


def main() -> int:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--name", default="faults", help="of the table in benchmarks/results")
    arguments = parser.parse_args()
    chance, outcomes = random.Random(arguments.seed), []
    script = HERE / "press.yaml"
    overrides = [f"gateway.instruments.{i}.arm.settings.script={script}" for i in (0, 1)]
    topics = tuple(f"{name}.health" for name in LOOPS)
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), str(SCENE), overrides, topics) as rig:
        for index in range(arguments.faults):
            outcome = strike(rig, chance.choice(LOOPS), chance.choice(SIGNALS), chance.uniform(0.0, 1.5))
            outcomes.append(outcome)
            print(index, outcome, *outcome.failures(), flush=True)
        log = (Path(folder) / "log").read_text()
    if any(outcome.failures() for outcome in outcomes):
        print(log[-4000:])
    notes = (
        f"Seed {arguments.seed}; the stub rig with the small scene, a hand that presses and lifts. Times are medians "
        "and, as 99 %, the longest; they include a restart's back-off. Forces are those of every device frame."
    )
    write_report(arguments.name, "Kills and freezes", _rows(outcomes), notes)
    return 1 if any(outcome.failures() for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
