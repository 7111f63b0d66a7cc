"""``trocar diagnose latency``: the worst ticks of all loops on one time line, of a rig or from files."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trocar.services.cli import targets
from trocar.services.diagnosis.bad_ticks import (
    FLOOR_LATE_NS,
    UNKNOWN,
    WAITED,
    BadTick,
    incidents,
    is_floor,
    woken_ns,
    worst_ticks,
)
from trocar.services.diagnosis.core_sleepers import watching
from trocar.services.diagnosis.thread_usage import ThreadUsage
from trocar.services.diagnosis.trace import trace
from trocar.services.files.atomic_file import atomic_file
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import BusError, ConfigError
from trocar.services.runtime.measures.flight import LOOK_S, flight_directory
from trocar.services.runtime.measures.flights import Flight, Flights, ThreadTime, read_file, read_rings, to_bytes

_THREADS = 8  # that took most of a core; the table of a tick then fits half a screen
_WIDTH = 110  # of a file or pipe: the time line's 60 and names and cores beside it
#: Of the time line: with names and cores beside it, it fits a terminal as it is opened.
_LINE = 60
_WORDS = "mostly; longest stage"
_LEGEND = (
    "s: before the end of what was kept; all else in us. late: started after its time; ran: on the core since the "
    "tick before; over: after its deadline. Mostly: what took most of the time from when it was due; "
    f"{UNKNOWN!r} is its frame on its way, a bus thread, or somebody who is no loop of the rig; "
    f"{WAITED!r}: it waited for one, says the kernel."
)


def run_latency(
    files: Sequence[Path],
    rig: str,
    worst: int,
    trace_file: Path | None,
    save: Path | None,
    as_json: bool,
    overrides: tuple[str, ...],
) -> None:
    """Show the worst ticks. Raises UserError if there is nothing to look at, or a file cannot be read or written."""
    targets.look_at_file("--trace", trace_file)
    targets.look_at_file("--save", save)
    taken = [read_file(path) for path in files] or [_now(rig, overrides)]
    if save is not None:
        _save(taken, save)
    if trace_file is not None:
        if len(taken) > 1:
            raise ConfigError(f"--trace: a trace is of one file, and {len(taken)} were given")
        targets.write_text("--trace", trace_file, json.dumps(trace(taken[0]), allow_nan=False))
        print(f"wrote {trace_file}: open it at https://ui.perfetto.dev", file=sys.stderr)
    if as_json:
        print(json.dumps([_plain(each, worst) for each in taken]))
        return
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _WIDTH)
    for each in taken:
        print_flights(console, each, worst)


def _save(taken: Sequence[Flights], path: Path) -> None:
    if len(taken) > 1:
        raise ConfigError(f"--save: a file has the ticks of one time, and {len(taken)} were given")
    with targets.writing("--save", path), atomic_file(path) as half:
        half.write_bytes(to_bytes(taken[0]))
    print(f"wrote {path}: `trocar diagnose latency {path}` shows it", file=sys.stderr)


def _now(rig: str, overrides: tuple[str, ...]) -> Flights:
    """Return the last seconds of the rig's loops, whether they run or died.

    Raises BusError if no loop has left any.
    """
    transport = config.load_rig(rig, overrides).transport
    rings = flight_directory(endpoints.run_directory(transport))
    pids = {flight.name: flight.pid for flight in read_rings(rings) if not is_floor(flight)}
    if not pids:
        raise BusError(f"no rig runs as {rig}, and no loop has left its last ticks in {rings}")
    threads = ThreadUsage()
    with watching(rings):
        for _ in range(2):
            threads.sample(time.monotonic(), pids)
            time.sleep(LOOK_S)
        threads.sample(time.monotonic(), pids)
        flights = read_rings(rings)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return Flights(flights, time.monotonic_ns(), now, "looked at by hand", threads.busiest())


def _plain(taken: Flights, worst: int) -> dict[str, object]:
    ticks = worst_ticks(taken.flights, worst, taken.threads)
    return {
        "taken_at": taken.taken_at,
        "reason": taken.reason,
        "loops": {f.name: len(f.rows) for f in taken.flights},
        "worst": [{**asdict(tick), "before_end_s": (taken.taken_ns - tick.due_ns) * 1e-9} for tick in ticks],
        "threads": [asdict(thread) for thread in taken.threads],
    }


def print_flights(console: Console, taken: Flights, worst: int) -> None:
    """Print the worst ticks of one time, its time line, and who ran."""
    console.print(f"{taken.taken_at}  {taken.reason}", style="bold", markup=False)
    ticks = worst_ticks(taken.flights, worst, taken.threads)
    if not ticks:
        console.print("no tick was late in what was kept")
    else:
        console.print(_table(ticks, taken))
        console.print(Text(_LEGEND, style="dim"))
        console.print(_time_line(max(ticks, key=lambda tick: tick.over_periods), taken.flights))
    if taken.threads:
        console.print(f"the kernel: who of the rig ran in the last {taken.threads[0].seconds:.1f} s")
        console.print(_thread_table(taken.threads))


def _table(ticks: Sequence[BadTick], taken: Flights) -> Table:
    table = _plain_table()
    for title in ("s", "process", "core", "tick", "late", "work", "ran", "over", _WORDS):
        table.add_column(title, justify="left" if title in ("process", _WORDS) else "right", no_wrap=title != _WORDS)
    for group in incidents(ticks):
        for tick in group:
            stage = f"{tick.longest_stage} {tick.longest_stage_ns / 1e3:.0f}" if tick.longest_stage else ""
            words = "; ".join(filter(None, (tick.why, stage)))
            numbers = (tick.began_ns - tick.due_ns, tick.ended_ns - tick.began_ns, tick.on_core_ns, tick.over_ns)
            cells = (f"{number / 1e3:.0f}" for number in numbers)
            at = f"{(tick.due_ns - taken.taken_ns) * 1e-9:.3f}"
            table.add_row(at, tick.process, _cores(tick.cores), str(tick.tick), *cells, words)
        table.add_section()
    return table


def _plain_table() -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))


def _cores(cores: tuple[int, ...]) -> str:
    return str(cores[0]) if len(cores) == 1 else "any"


def _time_line(tick: BadTick, flights: Sequence[Flight]) -> Text:
    """Return a line a loop over the time of a tick and a little more, and a line for the machine on each core."""
    margin_ns = (tick.ended_ns - tick.due_ns) // 4 + 1
    from_ns, to_ns = tick.due_ns - margin_ns, tick.ended_ns + margin_ns
    span_ms = (to_ns - from_ns) / 1e6
    text = Text(f"\nthe worst, {span_ms:.1f} ms: █ in its tick, ░ due and not begun, ! the machine wakes nobody\n")
    for flight in sorted(flights, key=lambda each: (each.cores, is_floor(each), each.name)):
        line = "".join(_cells(flight, from_ns, to_ns))
        name = "the machine" if is_floor(flight) else flight.name
        text.append(f"{name[:14]:<14}{_cores(flight.cores):>4} {line}\n")
    return text


def _cells(flight: Flight, from_ns: int, to_ns: int) -> list[str]:
    step = (to_ns - from_ns) / _LINE
    cells = [" "] * _LINE
    due, began, ended = (flight.column(name) for name in ("due_ns", "began_ns", "ended_ns"))
    waiting, working, least_ns = "░", "█", 0
    if is_floor(flight):
        began = ended = woken_ns(flight)
        waiting, working, least_ns = "!", "!", FLOOR_LATE_NS
    for row in ((due < to_ns) & (ended > from_ns) & (began - due >= least_ns)).nonzero()[0]:
        for mark, first, last in ((waiting, due[row], began[row]), (working, began[row], ended[row])):
            for cell in range(max(0, int((first - from_ns) / step)), min(_LINE, int((last - from_ns) / step) + 1)):
                if mark == working or cells[cell] == " ":
                    cells[cell] = mark
    return cells


def _thread_table(threads: Sequence[ThreadTime]) -> Table:
    table = _plain_table()
    for column in ("process", "thread", "ran %", "waited %", "switches/s"):
        table.add_column(column, justify="left" if column in ("process", "thread") else "right")
    for each in threads[:_THREADS]:
        shares = (f"{100 * each.ran_s / each.seconds:.1f}", f"{100 * each.waited_s / each.seconds:.1f}")
        table.add_row(each.process, each.thread, *shares, f"{each.switches / each.seconds:.0f}")
    return table
