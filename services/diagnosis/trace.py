"""Flights as a trace that Perfetto (ui.perfetto.dev) and chrome://tracing open: the Trace Event Format, as JSON.

https://docs.google.com/document/d/1CvAClvFfyA5R-PhYUmn5OOQtYMH4h6I0nSsKchNAySU
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from trocar.services.diagnosis.bad_ticks import is_floor, woken_ns
from trocar.services.diagnosis.core_sleepers import NAME as FLOOR
from trocar.services.runtime.measures.flight import COLUMNS
from trocar.services.runtime.measures.flights import Flight, Flights

#: A wake-up of the floor that is earlier than this is left out: there are a hundred a second.
_WORTH_NS = 100_000


def trace(flights: Flights) -> dict[str, Any]:
    """Return the trace: a track a process with its ticks and stages, marks at those that were late, and the machine.

    Stages are laid end to end from the beginning of their tick, as their order is known and not their gaps. Each
    thread has a number of its own, as on one host, and none is 0: to viewers that is the kernel's idle one.
    """
    rows = [flight for flight in flights.flights if len(flight.rows)]
    origin_ns = min((int(flight.column("due_ns").min()) for flight in rows), default=0)
    events: list[dict[str, Any]] = []
    pids: set[int] = set()
    for flight in rows:
        if is_floor(flight):
            continue
        pid = flight.pid if flight.pid not in pids else max(pids) + 1  # in containers each is the first of its own
        pids.add(pid)
        events += _loop(flight, pid, origin_ns)
    for flight in filter(is_floor, rows):
        events += _floor(flight, max(pids, default=0) + 1, origin_ns)
    about = {"taken_at": flights.taken_at, "reason": flights.reason, "origin_monotonic_ns": origin_ns}
    return {"traceEvents": events, "displayTimeUnit": "ms", "otherData": about}


def _loop(flight: Flight, pid: int, origin_ns: int) -> Iterator[dict[str, Any]]:
    yield _named(pid, pid, "process_name", f"{flight.name}, core {', '.join(map(str, flight.cores))}")
    yield _named(pid, pid, "thread_name", "ticks")
    for row in flight.rows.tolist():
        tick, due, began, ended, ran = row[: len(COLUMNS)]
        args = {"late_us": (began - due) / 1e3, "on_core_us": ran / 1e3}
        yield _span(pid, pid, f"tick {tick}", began - origin_ns, ended - began, args)
        at = began
        for stage, duration in zip(flight.stages, row[len(COLUMNS) :], strict=True):
            length = min(duration, ended - at)
            if length > 0:
                yield _span(pid, pid, stage, at - origin_ns, length, {})
                at += length
        if ended - due > flight.period_ns:
            over_us = (ended - due - flight.period_ns) / 1e3
            yield {
                "ph": "i", "s": "p", "name": f"missed by {over_us:.0f} us", "cat": "miss",
                "pid": pid, "tid": pid, "ts": (ended - origin_ns) / 1e3, "args": {"tick": tick},
            }  # fmt: skip


def _floor(flight: Flight, machine: int, origin_ns: int) -> Iterator[dict[str, Any]]:
    core = int(flight.name.removeprefix(FLOOR))
    track = machine + core
    yield _named(machine, track, "process_name", "the machine")
    yield _named(machine, track, "thread_name", f"core {core} wakes nobody")
    for due, woke in zip(flight.column("due_ns").tolist(), woken_ns(flight).tolist(), strict=True):
        if woke - due >= _WORTH_NS:
            yield _span(machine, track, "late", due - origin_ns, woke - due, {})


def _span(pid: int, tid: int, name: str, at_ns: int, length_ns: int, args: dict[str, float]) -> dict[str, Any]:
    span = {"ph": "X", "name": name, "cat": "loop", "pid": pid, "tid": tid, "ts": at_ns / 1e3, "dur": length_ns / 1e3}
    return {**span, "args": args} if args else span


def _named(pid: int, tid: int, what: str, name: str) -> dict[str, Any]:
    return {"ph": "M", "name": what, "pid": pid, "tid": tid, "args": {"name": name}}
