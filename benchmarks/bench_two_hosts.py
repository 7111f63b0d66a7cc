"""What a hand feels of a rig on two hosts, by delay, jitter and loss between them: docs/results/two-hosts.md.

    python -m benchmarks.bench_two_hosts

Both hosts are network namespaces of this machine, an hour apart by their clocks, with CURVE keys; between them is
`tests/rig/slow_road.c`. The left hand presses on the small scene's duct every 4.2 s. What it feels is judged on device
frames at the bench, against the same moments of the same press without delay. Picture, recorder and training are left
out: on one machine they would cost what on two they do not. Needs root.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections import Counter
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.report import describe_run, end_in_good_order, parse
from tests.rig.conftest import Sample
from tests.rig.faults import force_n, force_rates_n_s, rate_limit_n_s
from tests.rig.two_hosts import FarRig, Hosts
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.measures.histogram import quantile_ns

PAGE = Path(__file__).parents[1] / "docs" / "results" / "two-hosts.md"
PRESS_TICKS, SETTLE_S = 4200, 1.0
#: A force below it is none; where the press has more than the second, there should be one.
NONE_N, FELT_N = 1e-3, 0.02
BENCH = {
    "haptics": {"gateway": 0, "haptics": 0, "physics": 1, "supervisor": 1},
    "physics": {"gateway": 0, "haptics": 0, "physics": 0, "supervisor": 1},
}
#: Each on a rig of its own: what else is on the bench, then delay and jitter one way in ms, packets lost in percent.
RUNS = (
    ("haptics", (0, 0, 0), (1, 0, 0), (1, 1, 0), (5, 0, 0), (20, 0, 0)),
    ("haptics", (0, 0, 0), (1, 0, 1), (1, 0, 5), (1, 0, 20)),
    ("physics", (0, 0, 0), (20, 5, 0), (20, 5, 20)),
)


@dataclass(frozen=True)
class Felt:
    """One row of the table."""

    bench: str
    road: tuple[float, float, float]
    error_mn: tuple[float, float]  # median and largest, where the press has force
    limp_percent: float
    step_n_s: float
    missed_percent: float
    refused_percent: float
    state_age_ms: tuple[float, float]
    clock_ms: float
    shown: str


def press(samples: list[Sample]) -> tuple[FloatArray, FloatArray]:
    """Return moments of the press and forces (n, 3)."""
    return np.array([s.tick % PRESS_TICKS for s in samples]), np.array([s.force_n for s in samples])


def look(rig: FarRig, road: tuple[float, float, float], presses: int) -> dict[str, object]:
    """Set the road and observe some presses; the arm is engaged before, on a good road."""
    rig.hosts.set(0.0)
    observer = rig.observer
    observer.until(lambda: bool(observer.samples) and force_n(observer.samples[-1]) > FELT_N, 30.0, "a force")
    delay_ms, jitter_ms, lost_percent = road
    rig.hosts.set(delay_ms, jitter_ms, 0.01 * lost_percent)
    rig.look_for(SETTLE_S)
    before = {name: rig.health_of(name) for name in ("gateway", "haptics")}
    observer.samples.clear()
    observer.states.clear()
    rig.look_for(1e-3 * PRESS_TICKS * presses)
    samples, states = list(observer.samples), [body for _, body in observer.states]
    return {"samples": samples, "states": states, "before": before,
            "after": {name: rig.health_of(name) for name in before}}  # fmt: skip


def felt(bench: str, road: tuple[float, float, float], seen: dict[str, object], reference_n: FloatArray) -> Felt:
    """Return what was felt, against the forces (PRESS_TICKS, 3) without delay."""
    samples, before, after = seen["samples"], seen["before"], seen["after"]
    moments, forces_n = press(samples)
    pressed = np.linalg.norm(reference_n[moments], axis=1) > FELT_N
    error_mn = 1e3 * np.linalg.norm(forces_n - reference_n[moments], axis=1)[pressed]
    limp = np.linalg.norm(forces_n, axis=1)[pressed] < NONE_N
    gauges = [health["gateway"].gauges["models_invalid"] for health in (before, after)]
    was, now = (next(path for path in health["gateway"].paths if path.name == "device_model")
                for health in (before, after))  # fmt: skip
    asked, answered = max(1, now.asked - was.asked), now.answered - was.answered
    ages = [next(row.age for row in health["haptics"].topics if row.topic == "physics.state" and row.age)
            for health in (before, after)]  # fmt: skip
    counts = ages[1].counts.view() - ages[0].counts.view()
    shown = Counter(_in_short(state.reason) or state.state for state in seen["states"])
    said = ["gateway: no force"] if "no force" in after["gateway"].detail else []
    return Felt(
        bench, road, (float(np.median(error_mn)), float(error_mn.max())), 100.0 * float(limp.mean()),
        max(force_rates_n_s(samples)), 100.0 * (1.0 - answered / asked), 100.0 * (gauges[1] - gauges[0]) / asked,
        tuple(1e-6 * quantile_ns(counts, ages[1].deadline_ns, q) for q in (0.5, 0.99)),
        1e3 * after["haptics"].gauges.get("clock_off_s.physics", 0.0),
        "; ".join([*said, *(text for text, _ in shown.most_common(1))]),
    )  # fmt: skip


def _in_short(reason: str) -> str:
    """Return who does what, without figures."""
    words = re.sub(r"\b[\d.]+ (?:% of the |times )?", "", reason.partition(",")[0])
    return re.sub(r"(?: us)? (?:over|in|for) .*", "", words).strip()


def measure(run: tuple[str, tuple[float, float, float]], presses: int) -> list[Felt]:
    """Return the rows of one rig."""
    bench, *roads = run
    with (
        tempfile.TemporaryDirectory() as folder,
        Hosts(Path(folder)) as hosts,
        closing(FarRig(Path(folder), hosts, BENCH[bench])) as rig,
    ):
        rig.until_it_runs()
        seen = [look(rig, road, presses) for road in roads]
    moments, forces_n = press(seen[0]["samples"])
    sums, counts = np.zeros((PRESS_TICKS, 3)), np.bincount(moments, minlength=PRESS_TICKS)
    np.add.at(sums, moments, forces_n)
    reference_n = sums / np.maximum(counts, 1)[:, None]
    return [felt(bench, road, each, reference_n) for road, each in zip(roads, seen, strict=True)]


def page(rows: list[Felt]) -> str:
    """Return the table as Markdown."""
    run = describe_run()
    limit = rate_limit_n_s()
    lines = [
        "# Two hosts", "",
        f"Written by `python -m benchmarks.bench_two_hosts`, {run['date']}, commit {run['commit']}; "
        f"{run['cores']} cores of {run['cpu']}, load {run['load']}.", "",
        "The table shows what a network between two hosts does to the force. Network and time namespaces stand in "
        "for the hosts; packets of the TCP connections are delayed or lost on purpose. The first column names the "
        "processes on the gateway's host; the others are on the other host. A simulated hand presses a duct; errors "
        "are against the undelayed press of 110 mN. *Limp* is the share of the press without force, *step* the "
        f"largest change of force (limit: {limit:.0f} N/s), *late* the share of ticks whose force model has not come "
        "by the next tick, *refused* the share of models that are too old. *Age* is that of the state of physics "
        "when haptics reads it.",
        "",
        "|with the gateway|delay, one way|loss|median error, mN|largest error, mN|limp|step, N/s|late|refused|"
        "median age, ms|99th percentile, ms|clock uncertainty, ms|most frequent message|",
        "|" + "---|" * 13,
    ]  # fmt: skip
    for row in rows:
        delay, jitter, lost = row.road
        beside = ", ".join(name for name, host in BENCH[row.bench].items() if host == 0 and name != "gateway")
        lines.append(
            f"|{beside}|{delay:g}{f' to {delay + jitter:g}' if jitter else ''} ms|{lost:g} %|"
            f"{row.error_mn[0]:.1f}|{row.error_mn[1]:.0f}|{row.limp_percent:.0f} %|"
            f"{row.step_n_s:.0f}|{row.missed_percent:.0f} %|{row.refused_percent:.0f} %|"
            f"{row.state_age_ms[0]:.1f}|{row.state_age_ms[1]:.1f}|{row.clock_ms:.1f}|{row.shown}|"
        )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Measure and write the page; return 1 where a force stepped beyond the limit."""
    arguments = parse(__doc__, presses=(2, "of 4.2 s for each road"), only=("", "what is on the bench"))
    end_in_good_order()
    rows = [row for run in RUNS if arguments.only in ("", run[0]) for row in measure(run, arguments.presses)]
    print(page(rows))
    if not arguments.only:
        PAGE.write_text(page(rows), encoding="utf-8")
    return int(max(row.step_n_s for row in rows) > rate_limit_n_s())


if __name__ == "__main__":
    sys.exit(main())
