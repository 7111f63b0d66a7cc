"""A rig that is watched from outside while something runs beside it: counts each second, and which alarms were true.

    with WatchedRig(["--set", "recorder.sample_rate_hz=50"]) as rig:
        rig.watch(60.0)
        rows = rig.rows("alone")

An alarm is a state that the rig went into and a mark in its history. It is a false one where the histograms of the loop
that it names, or of the path, do not show what it says: the judge is checked by what the judged have counted.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import httpx
from report import Row

from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # for what the tests have, too

LOOPS = ("gateway", "haptics", "physics", "visualization", "recorder", "supervisor")
#: On whatever core they get: two processes that compute and two that fill memory.
STRESS = ["stress-ng", "--cpu", "2", "--vm", "2", "--vm-bytes", "128M", "--quiet"]
_FAST = ("gateway", "haptics", "physics")
#: What the stub rig's contracts ask of who is no loop of 1 kHz.
_DUE_HZ = {"visualization": 30.0}
_START_S, _END_S = 300.0, 60.0
#: What is told was measured up to so long before the sample that shows it, and is in the counts so long after.
_BEFORE_S, _AFTER_S = 4.0, 2.0
#: The supervisor counts from when the rig runs; the page shows that, and the counts, up to so long afterwards.
_SHOWN_S = 1.0
#: Edges of exported buckets are a factor of the root of two apart.
_EDGE = 0.7
_MARK = re.compile(
    r"(\w+)(?:\.\w+)?: (?:(?:stalled|silent|held up) for (\d+) ms|process \d+ is stopped by a signal(?: for (\d+) ms)?)"
)
_BURST = re.compile(r"(\w+): [\d.]+ % of the ticks lost over ([\d.]+) s, limit ([\d.]+) %")
_BUDGET = re.compile(r"(\w+): \d+ ticks lost in the last minute, budget (\d+)")
_PATH = re.compile(r"path (\w+): p99 \d+ us over (\d+) s, limit (\d+) us")
_SILENCES = re.compile(r"(\w+): fell silent (\d+) times in (\d+) s")
_FLOOD = re.compile(r"(\w+): floods ([\w.]+): \d+ frames beyond three times [\d.]+ Hz, as (\w+) counts them")
_SILENCE_S = 0.06
#: Of the samples of a path; its 99th percentile was over the limit in a window that is half of what is looked at.
_PATH_SHARE = 0.005


@dataclass(frozen=True)
class Sample:
    """What the rig exported at one time: `t` is the rig's, in seconds, and so are the events'."""

    t: float
    counts: dict[str, float]
    restarts: int


class History:
    """Samples of a rig, one a second: those of a watch, and what was seen before it began."""

    def __init__(self, earlier: Sequence[Sample] = ()) -> None:
        self.samples: list[Sample] = []
        self._earlier = list(earlier)

    @property
    def all(self) -> list[Sample]:
        """Every sample since the rig ran."""
        return self._earlier + self.samples

    def change(self, key: str, since: float | None = None, until: float = float("inf")) -> float:
        """Return by how much a count rose between the last sample before `since` and the first after `until`.

        Without `since` that is from the watch's first sample on; where there is none so early, since the rig ran. A
        process that was started anew counts from 0.
        """
        known = self.samples if since is None else self.all
        first = known[0] if since is None else next((s for s in reversed(known) if s.t <= since), known[0])
        after = next((s.t for s in known if s.t >= until), until)
        values = [s.counts.get(key, 0.0) for s in known if first.t <= s.t <= after]
        return sum(new - old if new >= old else new for old, new in itertools.pairwise(values))

    def over(
        self, family: str, label: str, seconds: float, since: float | None = None, until: float = float("inf")
    ) -> float:
        """Return how many durations lay above the last bucket edge that is not above `seconds`."""
        edges = [key for key in self.samples[-1].counts if key.startswith(f"{family}_bucket{{") and label in key]
        below = [key for key in edges if _edge(key) <= seconds]
        total = self.change(f"{family}_count{{{label}}}", since, until)
        return total - (self.change(max(below, key=_edge), since, until) if below else 0.0)

    def largest(self, name: str, label: str) -> float:
        """Return the largest duration in seconds; the upper edge of its bucket where one before the watch was larger.

        0 for nothing.
        """
        key = f"{name}_max_seconds{{{label}}}"
        first, last = (sample.counts.get(key, 0.0) for sample in (self.samples[0], self.samples[-1]))
        if last > first:
            return last
        family = f"{name}_seconds"
        keys = [key for key in self.samples[-1].counts if key.startswith(f"{family}_bucket{{") and label in key]
        total = self.change(f"{family}_count{{{label}}}")
        holding = [_edge(key) for key in keys if self.change(key) >= total]
        return min(holding, default=0.0) if total else 0.0

    def is_true(self, text: str, t: float) -> bool:
        """Return whether the counts bear out what was said at `t`."""
        until = t + _AFTER_S
        if m := _MARK.search(text):
            length_s = int(m[2] or m[3] or 0) / 1e3
            return self._periods(m[1], length_s, t - length_s - _BEFORE_S, until) >= 1
        if m := _BURST.search(text):
            since = t - float(m[2]) - _BEFORE_S
            due = _DUE_HZ.get(m[1], 1000.0) * float(m[2])
            return self._misses(m[1], since, until) >= float(m[3]) / 100.0 * min(due, self._ticks(m[1], since, until))
        if m := _BUDGET.search(text):
            since = max(t - 60.0 - _BEFORE_S, self._ran_since(t))
            return max(self._misses(m[1], since, until), self._not_run(m[1], since, until)) >= int(m[2])
        if m := _PATH.search(text):
            since, label = t - int(m[2]) - _BEFORE_S, f'path="{m[1]}"'
            over = self.over("trocar_path_latency_seconds", label, int(m[3]) * 1e-6, since, until)
            return over >= _PATH_SHARE * self.change(f"trocar_path_latency_seconds_count{{{label}}}", since, until)
        if m := _SILENCES.search(text):
            return self._periods(m[1], _SILENCE_S, t - float(m[3]) - _BEFORE_S, until) >= int(m[2])
        if m := _FLOOD.search(text):
            return self.change(f'trocar_gauge{{name="flood.{m[2]}",service="{m[3]}"}}', t - _BEFORE_S, until) > 0
        return False

    def _ran_since(self, t: float) -> float:
        """Return since when, at `t`, the rig's budgets count: what was lost before it ran is nobody's."""
        known = [sample for sample in self.all if sample.t <= t]
        first = next((k + 1 for k in reversed(range(len(known))) if not _runs(known[k])), 0)
        return known[first].t - _SHOWN_S if 0 < first < len(known) else float("-inf")

    def _periods(self, loop: str, seconds: float, since: float, until: float) -> float:
        return self.over("trocar_loop_period_seconds", f'loop="{loop}"', _EDGE * seconds, since, until)

    def _misses(self, loop: str, since: float, until: float) -> float:
        return self.change(f'trocar_deadline_misses_total{{loop="{loop}"}}', since, until)

    def _not_run(self, loop: str, since: float, until: float) -> float:
        """Return the ticks that were due, by the clock of its reports, and never ran: it waited for another."""
        lived_s = self.change(f'trocar_service_uptime_seconds{{service="{loop}"}}', since, until)
        return _DUE_HZ.get(loop, 1000.0) * lived_s - self._ticks(loop, since, until)

    def _ticks(self, loop: str, since: float, until: float) -> float:
        return self.change(f'trocar_loop_iterations_total{{loop="{loop}"}}', since, until)


def _runs(sample: Sample) -> bool:
    return any(sample.counts.get(f'trocar_rig_state{{state="{state}"}}') for state in ("running", "degraded"))


def _ask_first() -> None:
    """Give this thread, and it alone, the least niceness, where that is granted."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), -20)


def _edge(key: str) -> float:
    found = re.search(r'le="([^"]*)"', key)
    assert found is not None
    return float(found[1].replace("+Inf", "inf"))


class WatchedRig:
    """A stub rig while a ``with`` block lasts, with its own directory and ports.

    `options` are those of `trocar up`, and `environment` is added to that of this process.
    """

    def __init__(
        self, options: Sequence[str] = (), viewer: str = "web", environment: Mapping[str, str] | None = None
    ) -> None:
        self._options = ["--viewer", viewer, *options]
        self._environment = {**os.environ, **(environment or {})}
        # It asks before all that is ordinary: what is timed is the server's answer, not how long the one who asks
        # waits for a core. One connection is kept, as a browser does; another client each time took 20 ms of a core.
        self._asking = ThreadPoolExecutor(1, initializer=_ask_first)
        self._client = httpx.Client(timeout=60)
        self.answers_s: dict[str, float] = {}
        self.history = History()

    def __enter__(self) -> Self:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # what was started is ended then, too
        self._folder = tempfile.TemporaryDirectory()
        self.directory = Path(self._folder.name)
        bus, trocar = self.directory / "bus", str(Path(sys.executable).with_name("trocar"))
        settings = (f"transport.directory={bus}", f"recorder.directory={self.directory}", "supervisor.web.port=0",
                    "visualization.port=0")  # fmt: skip
        overrides = [word for setting in settings for word in ("--set", setting)]
        with (self.directory / "log").open("wb") as log:
            command = [trocar, "up", *overrides, *self._options]
            self.process = subprocess.Popen(
                command, cwd=ROOT, env=self._environment, stdout=log, stderr=subprocess.STDOUT
            )
        try:
            self._await_running(page_file(Transport(directory=bus)))
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        self.process.wait(_END_S)
        self._client.close()
        self._asking.shutdown()
        self._folder.cleanup()

    def _await_running(self, place: Path) -> None:
        until_s = time.monotonic() + _START_S
        while time.monotonic() < until_s and self.process.poll() is None:
            time.sleep(0.2)
            try:
                self.address = str(json.loads(place.read_text())["address"])
                self._sample()  # of what it loses while it starts, too: what it is told for later begins in between
            except (OSError, ValueError, KeyError, httpx.HTTPError):
                continue
            if _runs(self.history.samples[-1]):
                return
        raise SystemExit(f"the rig does not run:\n{(self.directory / 'log').read_text()[-2000:]}")

    def settle(self, seconds: float) -> None:
        """Let it run so long; what is told afterwards of the last minute is judged by what was counted here, too."""
        self.watch(seconds)

    def watch(self, seconds: float, look: Callable[[], object] = lambda: None) -> None:
        """Take a sample each second, and call `look` beside it."""
        self.history, self.answers_s, self._said = History(self.history.all), {}, {}
        self._began_s = time.monotonic()
        known = {(event["t"], event["text"]) for event in self._get("api/state").json()["events"]}
        while time.monotonic() - self._began_s < seconds:
            self._take(known)
            look()
            time.sleep(1.0)
        self._take(known)
        time.sleep(_AFTER_S)  # what was told last is in the counts by then
        self._take(known)
        self.seconds = self.history.samples[-1].t - self.history.samples[0].t

    def _sample(self) -> list[dict[str, Any]]:
        """Take what the rig exports; return the events that it shows."""
        metrics, state = self._get("metrics?level=full").text, self._get("api/state").json()
        rows = (line.rpartition(" ") for line in metrics.splitlines() if line[:1] != "#")
        restarts = sum(process["restarts"] for process in state["processes"])
        self.history.samples.append(Sample(state["t"], {key: float(value) for key, _, value in rows}, restarts))
        return list(state["events"])

    def _take(self, known: set[tuple[float, str]]) -> None:
        events = self._sample()
        self._get("")
        for event in events:
            if (event["t"], event["text"]) not in known:
                self._said[event["t"], event["text"]] = event["level"]

    def _get(self, path: str) -> httpx.Response:
        answer, took_s = self._asking.submit(self._timed, f"{self.address}{path}").result()
        known = path.partition("?")[0]
        self.answers_s[known] = max(took_s, self.answers_s.get(known, 0.0))
        return answer

    def _timed(self, address: str) -> tuple[httpx.Response, float]:
        began_s = time.monotonic()
        answer = self._client.get(address)
        return answer, time.monotonic() - began_s

    def alarms(self) -> tuple[list[str], list[str]]:
        """Return the alarms of the time that was watched, and those of them that nobody's histograms bear out."""
        # What is told of before, or is not in the counts yet, cannot be judged.
        first_s, last_s = self.history.all[0].t + _BEFORE_S, self.history.samples[-1].t - _AFTER_S
        told = [
            (t, text)
            for (t, text), level in self._said.items()
            if first_s < t <= last_s and (level != "info" or _MARK.search(text))
        ]
        return [text for _, text in told], [text for t, text in told if not self.history.is_true(text, t)]

    def rows(self, where: str, asked_percent: float = 0.2) -> list[Row]:
        """Return what was counted: loops, alarms, answers, the supervisor's own lateness."""
        history, rows = self.history, []
        for loop in LOOPS[:4]:
            ticks = history.change(f'trocar_loop_iterations_total{{loop="{loop}"}}')
            misses = history.change(f'trocar_deadline_misses_total{{loop="{loop}"}}')
            limit = asked_percent if loop in _FAST else None
            rows.append(Row(f"{loop}: late or lost ticks", 100.0 * misses / max(1.0, ticks, misses), "%", limit))
            lived_s = history.change(f'trocar_service_uptime_seconds{{service="{loop}"}}')  # of the counts' own reports
            rows.append(Row(f"{loop}: rate", ticks / max(1e-3, lived_s), "Hz"))
        told, untrue = self.alarms()
        restarts = history.samples[-1].restarts - history.samples[0].restarts
        rows += [
            Row("processes restarted", restarts, "", 0.0),
            Row("changes of state for the worse, and marks", len(told), ""),
            Row("of them false", len(untrue), "", 0.0),
            Row("supervisor: largest lateness",
                1e3 * history.largest("trocar_loop_lateness", 'loop="supervisor"'), "ms", 20.0),
            *(Row(f"/{path} answered, slowest", 1e3 * s, "ms", 1000.0) for path, s in self.answers_s.items()),
        ]  # fmt: skip
        return [Row(f"{where}: {row.name}", **{k: v for k, v in vars(row).items() if k != "name"}) for row in rows]

    def ready_s(self, process: str) -> float:
        """Return how long after the supervisor's start a process was ready for the first time."""
        events = self._get("api/state").json()["events"]
        return min(float(event["t"]) for event in events if event["text"].startswith(f"{process}: ready"))

    def gauge(self, service: str, name: str) -> float:
        """Return a gauge of a process as it was last."""
        return self.history.samples[-1].counts.get(f'trocar_gauge{{name="{name}",service="{service}"}}', 0.0)


def print_alarms(rig: WatchedRig, where: str) -> None:
    """Say on stderr what the rig said, and what of it was false."""
    told, untrue = rig.alarms()
    document: dict[str, Any] = {"where": where, "told": told, "false": untrue}
    print(json.dumps(document, indent=1), file=sys.stderr)
