"""Kills and freezes of gateway, haptics and physics at random: how the hand fares, and how the rig comes back.

    python benchmarks/bench_faults.py [--faults 200] [--seed 14] [--minutes 5] [--keep]

A rig whose left hand presses on the duct, SIGKILL or SIGSTOP of one of the three at a random moment, then: how long
until the supervisor says so, how long until forces are on again (the rig is RUNNING or DEGRADED), whether it is
RUNNING within a minute (DEGRADED is not), whether a force ever stepped by more than the rate limit, and how fast each
loop runs in the two seconds around the fifth after the fault, beside a bare sleeper on each core above every process of
the rig (`machine_floor`). Where forces came back later than three seconds after the fault, the two seconds begin one
second after that. Exit status 1 if any of it fails.

Outcomes are kept beside the table, so that a run of `--minutes` goes on where the last one of that seed stopped, unless
what was struck then is other code than what lies here now: a table is of one rig, so it is begun anew. With `--keep`
what was struck in other code stays, and the table says how many were of which commit, and how many of each failed. One
that is ended by SIGTERM takes its rig with it. 200 faults take about 25 minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from machine_floor import Floor
from report import RESULTS, Row, commit, end_in_good_order, write_report

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests' rig is launched as a user would

from tests.rig.conftest import HERE, SCENE, Rig, running_rig
from tests.rig.faults import engage, force_rates_n_s, rate_limit_n_s
from trocar.protocol.bodies import SupervisorState

ROOT = Path(__file__).resolve().parents[1]
LOOPS = ("gateway", "haptics", "physics")
SIGNALS = (signal.SIGKILL, signal.SIGSTOP)
BACK_S, SLOWEST_HZ = 60.0, 990.0
#: Rates are those of so long, around so long after a fault, and not before forces have been on for so long.
MEASURED_S, JUDGED_S, SETTLED_S = 2.0, 5.0, 1.0
NOTICE_S, LATEST_NOTICE_S = 0.05, 0.1
#: What a struck rig is made of, and what strikes it: where it changes, earlier outcomes are another rig's.
_RIG = ("services", "protocol", "configs", "tests/scenes/small.yaml", "tests/rig/press.yaml")
CODE = (*_RIG, "tests/rig/conftest.py", "tests/rig/faults.py", "benchmarks/bench_faults.py")


@dataclass(frozen=True)
class Outcome:
    """Of one fault."""

    process: str
    signal: str
    forces_on_s: float  # RUNNING or DEGRADED
    running_s: float | None  # RUNNING; None: not within `BACK_S`
    state: str  # of the rig at the end, and why
    fastest_n_s: float
    rates_hz: dict[str, float]
    noticed_s: float | None = None  # until the supervisor said that the process is not ready
    floor_late_percent: float | None = None  # wake-ups of a bare sleeper while the rates were measured, the worse core
    commit: str = ""  # of the rig that was struck

    def failures(self) -> list[str]:
        """Return what went wrong, a sentence each."""
        found = [] if self.forces_on_s < BACK_S else [f"no forces within {BACK_S:g} s"]
        if self.noticed_s is None or self.noticed_s > LATEST_NOTICE_S:
            found.append(f"noticed after {self.noticed_s} s")
        if self.running_s is None:
            found.append(f"not RUNNING: {self.state}")
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
    observer.look()
    said, pid = len(observer.states), observer.pids()[process]
    struck = time.monotonic()
    os.kill(pid, number)
    try:
        observer.until(lambda: observer.pids()[process] not in (0, pid), BACK_S, f"{process} replaced")
        observer.until(lambda: _has_forces(rig, said), BACK_S, "forces on again")
    except AssertionError as error:
        print(error, file=sys.stderr)
    again_s, noticed_s = time.monotonic() - struck, _noticed_s(observer.states[said:], process, pid, struck)
    said = len(observer.states) - 1  # the last is what `again_s` was read off
    settled_s = max(JUDGED_S - MEASURED_S / 2, again_s + SETTLED_S)
    with Floor(MEASURED_S, struck + settled_s) as floor:
        _ticks(rig, struck + settled_s - time.monotonic())
        seen = _ticks(rig, MEASURED_S)
    running_s = _running_s(rig, said, struck)
    state = f"{observer.rig_state} {observer.states[-1][1].reason}".strip()
    fastest_n_s = max(force_rates_n_s(observer.samples), default=0.0)
    rates_hz = {name: _rate_hz(seen[name]) for name in LOOPS}
    late_percent = max(core["lost_percent"] for core in floor.cores)
    return Outcome(
        process, number.name, again_s, running_s, state, fastest_n_s, rates_hz, noticed_s, late_percent, commit()
    )  # fmt: skip


def _running_s(rig: Rig, said: int, struck_s: float) -> float | None:
    """Return how long after `struck_s` the rig was RUNNING, and wait for it as long as it may take."""
    observer = rig.observer

    def since() -> list[int]:
        return [sent_ns for sent_ns, body in observer.states[said:] if body.state == "running"]

    with suppress(AssertionError):
        observer.until(lambda: bool(since()), max(0.0, struck_s + BACK_S - time.monotonic()), "RUNNING")
    return 1e-9 * since()[0] - struck_s if since() else None


def _noticed_s(states: list[tuple[int, SupervisorState]], process: str, pid: int, struck_s: float) -> float | None:
    """Return how long after `struck_s` the supervisor said that `process` is not what it was; None for never."""
    for sent_ns, body in states:
        report = next(each for each in body.processes if each.name == process)
        if sent_ns * 1e-9 >= struck_s and (report.state != "ready" or report.pid != pid):
            return sent_ns * 1e-9 - struck_s
    return None


def _has_forces(rig: Rig, said: int) -> bool:
    """Return whether forces are on, by what the supervisor says after having said `said`."""
    observer = rig.observer
    reports = {name: observer.report(name) for name in LOOPS}
    is_up = observer.rig_state in ("running", "degraded") and len(observer.states) > said
    return is_up and set(reports.values()) == {"ready"}


def _rows(outcomes: list[Outcome]) -> list[Row]:
    rows = [
        Row("fastest change of force from tick to tick", max(o.fastest_n_s for o in outcomes), "N/s", rate_limit_n_s())
    ]
    noticed = [o.noticed_s for o in outcomes if o.noticed_s is not None]
    for number in SIGNALS:
        some_ms = [1e3 * o.noticed_s for o in outcomes if o.noticed_s is not None and o.signal == number.name]
        if some_ms:
            median_ms = float(np.median(some_ms))
            rows.append(Row(f"{number.name}: noticed after", median_ms, "ms", 1e3 * NOTICE_S, p99=max(some_ms)))
    if noticed:
        rows.append(Row("longest until one was noticed", 1e3 * max(noticed), "ms", 1e3 * LATEST_NOTICE_S))
    for process in LOOPS:
        for number in SIGNALS:
            some = [o for o in outcomes if (o.process, o.signal) == (process, number.name)]
            if some:
                seconds = np.array([o.forces_on_s for o in some])
                name = f"{process}, {number.name}: RUNNING or DEGRADED again (of {len(some)})"
                rows.append(Row(name, float(np.median(seconds)), "s", BACK_S, p99=float(seconds.max())))
    for loop in LOOPS:
        rates = np.array([o.rates_hz[loop] for o in outcomes])
        name = f"{loop}: slowest around five seconds later"
        rows.append(
            Row(name, float(rates.min()), "Hz", SLOWEST_HZ, at_least=True, extra={"p50": float(np.median(rates))})
        )
    rows += _floor_rows(outcomes)
    running = [o.running_s for o in outcomes if o.running_s is not None]
    rows.append(Row("RUNNING within a minute", 100.0 * len(running) / len(outcomes), "%", 100.0, at_least=True))
    if running:
        rows.append(Row("RUNNING, of those, after", float(np.median(running)), "s", BACK_S, p99=max(running)))
    return rows + _failed_rows(outcomes)


def _failed_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return after how many something failed: of all, and of each commit where there are several."""
    failed = [_at(o) for o in outcomes if o.failures()]
    rows = [Row(f"faults after which something failed, of {len(outcomes)}", float(len(failed)), "", 0.0)]
    struck = Counter(map(_at, outcomes))
    if len(struck) > 1:
        rows += [Row(f"of them at {at}, of {n}", float(failed.count(at)), "") for at, n in struck.items()]
    return rows


def _at(outcome: Outcome) -> str:
    return outcome.commit or "an earlier commit"


def struck_rigs(outcomes: list[Outcome]) -> str:
    """Return how many of `outcomes` are of a rig of which commit, in the order in which they were struck."""
    return ", ".join(f"{n} at {commit}" for commit, n in Counter(map(_at, outcomes)).items())


def _floor_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return what a bare sleeper missed while the rates were measured: always, and where a loop was too slow."""
    slow = [o for o in outcomes if min(o.rates_hz.values()) < SLOWEST_HZ]
    rows = []
    for of, some in (("", outcomes), (f", a loop below {SLOWEST_HZ:g} Hz", slow)):
        late = [o.floor_late_percent for o in some if o.floor_late_percent is not None]
        if late:
            name = f"late wake-ups of a bare sleeper in the same two seconds{of} (of {len(late)})"
            rows.append(Row(name, float(np.median(late)), "%", p99=max(late)))
    return rows


def _draws(seed: int, n: int) -> list[tuple[str, signal.Signals, float]]:
    """Return which process is struck how, and how long after the hand feels something."""
    chance = random.Random(seed)
    return [(chance.choice(LOOPS), chance.choice(SIGNALS), chance.uniform(0.0, 1.5)) for _ in range(n)]


def kept(file: Path, seed: int, root: Path = ROOT, *, is_any_code: bool = False) -> list[Outcome]:
    """Return the outcomes of earlier runs with the same seed; none where any was of other code, unless any will do."""
    data = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    outcomes = [Outcome(**each) for each in data["outcomes"]] if data.get("seed") == seed else []
    if is_any_code:
        return outcomes
    others = sorted({outcome.commit for outcome in outcomes if not is_same_code(outcome.commit, root)})
    if others:
        print(f"{len(outcomes)} outcomes are forgotten: {', '.join(others)} is other code", file=sys.stderr)
        return []
    return outcomes


def is_same_code(commit: str, root: Path = ROOT) -> bool:
    """Return whether what lies in `root` now, committed or not, is what that commit's rig was made of."""
    if not commit:
        return False
    command = ["git", "diff", "--quiet", commit, "--", *CODE]
    return subprocess.run(command, cwd=root, stderr=subprocess.DEVNULL, check=False).returncode == 0


def main() -> int:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after so long, to go on another time")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--anew", action="store_true", help="forget the outcomes of earlier runs")
    which.add_argument("--keep", action="store_true", help="go on after those of other code, too")
    parser.add_argument("--name", default="faults", help="of the table in benchmarks/results")
    arguments = parser.parse_args()
    end_in_good_order()
    file = RESULTS / f"{arguments.name}-outcomes.json"
    outcomes = [] if arguments.anew else kept(file, arguments.seed, is_any_code=arguments.keep)
    script = HERE / "press.yaml"
    overrides = [f"gateway.instruments.{i}.arm.settings.script={script}" for i in (0, 1)]
    # A fault comes every nine seconds; who is restarted more than five times a minute would be given up.
    overrides.append("supervisor.max_restarts_per_minute=60")
    topics = tuple(f"{name}.health" for name in LOOPS)
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), str(SCENE), overrides, topics) as rig:
        end_s = time.monotonic() + 60.0 * arguments.minutes
        for index, draw in enumerate(_draws(arguments.seed, arguments.faults)):
            if index < len(outcomes) or time.monotonic() >= end_s:
                continue
            outcome = strike(rig, *draw)
            outcomes.append(outcome)
            print(index, outcome, *outcome.failures(), flush=True)
            data = {"seed": arguments.seed, "outcomes": [asdict(each) for each in outcomes]}
            file.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        log = (Path(folder) / "log").read_text()
    if any(outcome.failures() for outcome in outcomes):
        print(log[-4000:])
    notes = (
        f"Seed {arguments.seed}, {len(outcomes)} of {arguments.faults} faults; the stub rig with the small scene, a "
        "hand that presses and lifts; a process may be restarted as often as it is struck. Times are medians and, as "
        "99 %, the longest; they include a restart's back-off. "
        "Forces are those of every device frame. After a fault the budget of a minute may keep the rig DEGRADED: "
        "forces are on, but it is not counted as RUNNING. Rates are those of the two seconds around the fifth after "
        f"the fault. Struck were rigs of these commits: {struck_rigs(outcomes)}."
    )
    write_report(arguments.name, "Kills and freezes", _rows(outcomes), notes)
    return 1 if any(outcome.failures() for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
