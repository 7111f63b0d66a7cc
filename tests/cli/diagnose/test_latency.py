"""The worst ticks on one time line: what is blamed is what was put there, and the trace is one that viewers open."""

from __future__ import annotations

import dataclasses
import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from trocar.services.cli.app import app
from trocar.services.cli.diagnose.latency import print_flights
from trocar.services.diagnosis.bad_ticks import incidents, worst_ticks
from trocar.services.diagnosis.trace import trace
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.measures.flight import COLUMNS, FlightRing, flight_directory, remove_rings
from trocar.services.runtime.measures.flights import Flight, Flights, ThreadTime, to_bytes

MS = 1_000_000
START = 5_000 * MS


def flight(
    name: str, core: int, work_us: float, changes: dict[int, dict[str, float]] | None = None, rate: float = 1000.0
) -> Flight:
    """Return two hundred ticks that take `work_us` in two stages, all of it on the core, but for `changes` (us)."""
    rows = []
    for k in range(200):
        change = (changes or {}).get(k, {})
        due = START + round(k * 1e9 / rate)
        began = due + round(1e3 * change.get("late", 20.0))
        work = round(1e3 * change.get("work", work_us))
        ran = round(1e3 * change.get("ran", work / 1e3))
        rows.append([k, due, began, began + work, ran, work // 4, work - work // 4])
    return Flight(name, 10 + core, rate, (core,), ("read", "solve"), np.array(rows))


def floor(core: int, late_us: dict[int, float] | None = None) -> Flight:
    due = [START + k * 10 * MS for k in range(20)]
    woke = [at + round(1e3 * (late_us or {}).get(k, 40.0)) for k, at in enumerate(due)]
    rows = [[k, at, then, then, 0] for k, (at, then) in enumerate(zip(due, woke, strict=True))]
    return Flight(f"floor{core}", 99, 100.0, (core,), (), np.array(rows))


def test_nothing_late_is_nothing_to_show() -> None:
    assert worst_ticks([flight("physics", 1, 300.0), floor(1)], 10) == []


def test_own_work_is_told_with_its_longest_stage() -> None:
    (tick,) = worst_ticks([flight("physics", 1, 300.0, {50: {"work": 2500.0}}), floor(1)], 10)
    assert (tick.process, tick.tick, tick.longest_stage) == ("physics", 50, "solve")
    assert tick.over_ns == pytest.approx(1.52e6)
    assert tick.why == "its own work 2.50 ms"


def test_another_loop_on_the_same_core_is_named_and_one_on_another_is_not() -> None:
    late = flight("haptics", 0, 200.0, {50: {"work": 2500.0, "ran": 200.0}})
    gateway = flight("gateway", 0, 60.0, {50: {"late": 40.0, "work": 2300.0}})
    physics = flight("physics", 1, 60.0, {50: {"late": 40.0, "work": 2300.0}})
    by_name = {tick.process: tick.why for tick in worst_ticks([late, gateway, physics], 10)}
    assert by_name["haptics"] == "gateway 2.42 ms"  # 2.3, and twice the 60 us of its next ticks
    alone = {tick.process: tick.why for tick in worst_ticks([late, physics], 10)}
    assert alone["haptics"] == "unknown 2.32 ms"


def test_the_machine_is_to_blame_where_it_woke_nobody_on_that_core() -> None:
    late = flight("physics", 1, 300.0, {50: {"late": 3000.0}})
    (tick,) = worst_ticks([late, floor(0), floor(1, {5: 2800.0})], 10)
    assert tick.why == "the machine 2.80 ms"
    (tick,) = worst_ticks([late, floor(0, {5: 2800.0}), floor(1)], 10)
    assert tick.why.startswith("unknown")
    (tick,) = worst_ticks([late, floor(1, {9: 2800.0})], 10)  # at another time
    assert tick.why.startswith("unknown")


def test_while_a_watcher_was_runnable_and_waited_the_machine_is_not_to_blame() -> None:
    """Loops with SCHED_DEADLINE come before it."""
    late, watcher = flight("physics", 1, 300.0, {50: {"late": 3000.0}}), floor(1, {5: 2800.0})
    watcher.rows[5, COLUMNS.index("ran_ns")] = 2700 * 1000
    (tick,) = worst_ticks([late, watcher], 10)
    assert tick.why.startswith("unknown")
    events = trace(Flights((late, watcher), 0, "now", "why"))["traceEvents"]
    assert max(event["dur"] for event in events if event["name"] == "late") == pytest.approx(100.0)
    console = Console(width=110, record=True, file=io.StringIO())
    print_flights(console, Flights((late, watcher), 0, "now", "why"), 10)
    (machine,) = [line for line in console.export_text().splitlines() if line.startswith("the machine")]
    assert "!" not in machine


def test_the_worst_by_periods_are_taken_in_the_order_of_time_and_what_belongs_together_is() -> None:
    physics = flight("physics", 1, 300.0, {k: {"work": 1000.0 + 10 * k} for k in (20, 21, 120)})
    haptics = flight("haptics", 0, 200.0, {21: {"work": 9000.0}})
    picture = flight("visualization", 0, 200.0, {1: {"work": 30_000.0}}, rate=36.0)  # 0.1 of its period: the least
    ticks = worst_ticks([physics, haptics, picture], 3)
    assert [(tick.process, tick.tick) for tick in ticks] == [("haptics", 21), ("physics", 21), ("physics", 120)]
    assert [len(group) for group in incidents(ticks)] == [2, 1]


def test_what_the_hand_does_not_feel_leaves_room_for_what_it_does() -> None:
    held_up = {k: {"work": 900_000.0} for k in range(100)}
    picture, physics = (
        flight("visualization", 0, 200.0, held_up, rate=36.0),
        flight("physics", 1, 300.0, {7: {"work": 1200.0}}),
    )
    assert [tick.process for tick in worst_ticks([picture], 8)] == ["visualization"] * 8
    alone = flight("physics", 1, 300.0, {k: {"work": 1200.0} for k in range(50)})
    assert [tick.process for tick in worst_ticks([picture, alone], 8)].count("visualization") == 2
    assert [tick.process for tick in worst_ticks([picture, physics], 8)].count("visualization") == 7


@pytest.mark.parametrize(("waited_s", "why"), [(1.5, "no core 2.32 ms"), (0.1, "unknown 2.32 ms")])
def test_of_who_waited_for_a_core_the_kernel_says_so(waited_s: float, why: str) -> None:
    late = flight("haptics", 0, 200.0, {50: {"work": 2500.0, "ran": 200.0}})
    threads = [ThreadTime("haptics", "python3", 2.0, 0.4, waited_s, 1000), ThreadTime("physics", "x", 2.0, 0.1, 1.9, 9)]
    (tick,) = worst_ticks([late], 10, threads)
    assert tick.why == why


def _check_event(event: dict[str, Any]) -> None:
    """What the Trace Event Format asks of the kinds that are used."""
    assert event["ph"] in "XiM"
    assert isinstance(event["name"], str)
    assert isinstance(event["pid"], int)
    assert isinstance(event["tid"], int)
    assert (
        event["pid"] > 0
    )  # 0 is the kernel's idle process and thread, which viewers leave out of some of what they show
    assert event["tid"] > 0
    if event["ph"] == "M":
        assert event["name"] in ("process_name", "thread_name")
        assert isinstance(event["args"]["name"], str)
        return
    assert event["ts"] >= 0
    if event["ph"] == "X":
        assert event["dur"] >= 0
    else:
        assert event["s"] in "gpt"


def _check_tracks(events: list[dict[str, Any]]) -> None:
    """On a track a span lies within another or beside it: what overlaps is left out by who shows it."""
    tracks: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for event in events:
        if event["ph"] == "X":
            begin = event["ts"]
            tracks.setdefault((event["pid"], event["tid"]), []).append((begin, -event["dur"]))
    for track, spans in tracks.items():
        ends: list[float] = []
        for begin, negative in sorted(spans):
            while ends and ends[-1] <= begin + 1e-6:
                ends.pop()
            assert not ends or begin - negative <= ends[-1] + 1e-6, track
            ends.append(begin - negative)


def test_processes_of_one_number_have_tracks_of_their_own() -> None:
    """As those of containers have: each is the first of its own."""
    first, second = flight("physics", 1, 300.0, {}), flight("haptics", 0, 450.0, {})
    second = dataclasses.replace(second, pid=first.pid)
    events = trace(Flights((first, second, floor(0, {5: 900.0}), floor(1, {5: 2800.0})), 0, "now", "why"))[
        "traceEvents"
    ]
    _check_tracks(events)
    owners = {(e["tid"], e["pid"]) for e in events}
    assert len(owners) == len({tid for tid, _ in owners}) == 4, "a thread is of one process"
    assert len({e["pid"] for e in events if e["ph"] == "M" and e["name"] == "process_name"}) == 3


def test_the_trace_has_every_tick_nested_stages_and_a_mark_at_each_miss() -> None:
    flights = (flight("physics", 1, 300.0, {50: {"work": 2500.0}, 90: {"late": 3000.0}}), floor(1, {5: 2800.0}))
    made = json.loads(json.dumps(trace(Flights(flights, 0, "now", "why")), allow_nan=False))
    events = made["traceEvents"]
    for event in events:
        _check_event(event)
    assert {"traceEvents", "displayTimeUnit"} <= made.keys()
    ticks = [e for e in events if e["ph"] == "X" and e["name"].startswith("tick ")]
    assert len(ticks) == 200
    inside = [e for e in events if e["name"] == "solve"]
    assert len(inside) == 200
    for outer, inner in zip(ticks, inside, strict=True):  # nested, or a viewer draws them wrongly
        assert outer["ts"] <= inner["ts"] + 1e-6
        assert inner["ts"] + inner["dur"] <= outer["ts"] + outer["dur"] + 1e-6
    assert ticks[50]["dur"] == 2500.0
    assert [e["args"]["tick"] for e in events if e["ph"] == "i"] == [50, 90]
    assert [e["dur"] for e in events if e["name"] == "late"] == [2800.0]
    names = {(e["pid"], e["args"]["name"]) for e in events if e["name"] == "process_name"}
    assert names == {(11, "physics, core 1"), (12, "the machine")}


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    flights = (flight("physics", 1, 300.0, {50: {"work": 2500.0}}), floor(1))
    thread = ThreadTime("physics", "python3", 2.0, 0.6, 0.02, 4000)
    file = tmp_path / "kept.npz"
    file.write_bytes(to_bytes(Flights(flights, START + 250 * MS, "2026-11-20", "physics: 1 ticks missed", (thread,))))
    return file


def test_the_command_shows_a_file(kept: Path) -> None:
    done = CliRunner().invoke(app, ["diagnose", "latency", str(kept)])
    assert done.exit_code == 0, done.output
    for words in ("physics: 1 ticks missed", "-0.200", "solve 1875", "its own work 2.50 ms", "the machine", "30.0"):
        assert words in done.output
    assert max(map(len, done.output.splitlines())) <= 110


def test_in_a_terminal_of_eighty_columns_nothing_is_cut_and_a_loop_has_one_line() -> None:
    """Ellipses stood for the tick and for what took it, and the bars of loops that work all the time fell a line."""
    late = {50: {"late": 123_456.0, "work": 234_567.0, "ran": 345_678.0}}
    names = ("visualization", "supervisor", "gateway")
    flights = [dataclasses.replace(flight(name, k, 300.0, late, rate=36.0)) for k, name in enumerate(names)]
    flights = [dataclasses.replace(each, cores=(0, 1)) if each.name == names[0] else each for each in flights]
    threads = tuple(ThreadTime(name, "ZMQbg/IO/0", 2.0, 0.6, 0.02, 4000) for name in names)
    console = Console(width=80, record=True, file=io.StringIO())
    seen = Flights((*flights, floor(0), floor(1)), START + 9_000 * MS, "2026-11-20", "by hand", threads)
    print_flights(console, seen, 12)
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= 80
    assert not any("\u2026" in line for line in lines)
    for name in names:
        (bar,) = [line for line in lines if line.startswith(name) and set(line) & set("█░")]
        assert len(bar) > 70
        (row,) = [line for line in lines if f" {name} " in line and "123456" in line]
        assert {"50", "123456", "234567", "330245"} <= set(row.split())


def test_the_command_writes_a_trace_and_json(kept: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["diagnose", "latency", str(kept), "--json", "--trace", str(tmp_path / "t.json")])
    assert done.exit_code == 0, done.output
    (shown,) = json.loads(done.stdout)
    assert shown["worst"][0]["tick"] == 50
    assert shown["worst"][0]["before_end_s"] == pytest.approx(0.2)
    assert len(json.loads((tmp_path / "t.json").read_text())["traceEvents"]) > 600


def _run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["diagnose", "latency", *arguments])


def test_a_running_or_dead_rig_is_looked_at_and_what_is_seen_can_be_kept(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    rig = ["--set", f"transport.directory={run}"]
    nothing = _run(*rig)
    assert "no loop has left its last ticks" in str(nothing.exception)
    assert isinstance(nothing.exception, BusError)
    ring = FlightRing(1000.0, ("solve",))
    ring.share(flight_directory(run) / "physics.flight")
    for k in range(10):
        ring.write(k, k * MS, k * MS, k * MS + (3 * MS if k == 4 else 1), 3 * MS, (1,))
    running = _run(*rig, "--save", str(tmp_path / "kept.npz"))
    assert "looked at by hand" in running.output
    assert "its own work 3.00 ms" in running.output
    assert f"{os.getpid()}" not in running.output
    assert [path.name for path in flight_directory(run).iterdir()] == ["physics.flight"], "the watchers' rings are gone"
    remove_rings(run)
    assert "its own work 3.00 ms" in _run(str(tmp_path / "kept.npz")).output


def test_what_cannot_be_written_or_read_is_one_sentence(kept: Path, tmp_path: Path) -> None:
    assert "there is no folder" in str(_run(str(kept), "--trace", str(tmp_path / "no" / "t.json")).exception)
    assert "No such file" in str(_run(str(tmp_path / "no.npz")).exception)
    assert "the ticks of one time" in str(_run(str(kept), str(kept), "--save", str(tmp_path / "x")).exception)
    assert "a trace is of one file" in str(_run(str(kept), str(kept), "--trace", "x").exception)


def test_columns_are_those_of_the_ring() -> None:
    assert COLUMNS[:5] == ("tick", "due_ns", "began_ns", "ended_ns", "ran_ns")
