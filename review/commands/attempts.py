"""``trocar attempts``: what was kept of trainees: listed, drawn, exported, erased."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.review.attempts.curve import cusum, learning_curve
from trocar.review.attempts.store.attempts import Listed, Store, UnknownError
from trocar.services.atomic_file import atomic_file
from trocar.services.cli import targets
from trocar.services.training.score import load_rules


def run_list(database: str | None, trainee: str | None, scenario: str | None, as_json: bool) -> None:
    """Print the attempts, oldest first."""
    with Store(database) as store:
        rows = store.listed(trainee, scenario)
    if as_json:
        print(msgspec.json.encode({"attempts": rows}).decode())
        return
    table = Table(box=None, pad_edge=False)
    for title in ("attempt", "trainee", "scenario", "when", "outcome", "counts", "time, s", "score", "errors"):
        table.add_column(title, justify="right" if title in ("attempt", "time, s", "score", "errors") else "left")
    for row in rows:
        table.add_row(*_cells(row))
    console = Console(highlight=False)
    console.print(table)
    console.print(f"{len(rows)} attempts; `trocar report NUMBER` shows one")


def _cells(row: Listed) -> tuple[str, ...]:
    when = datetime.fromtimestamp(row.began_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M")
    score = "" if row.total is None else f"{row.total:.0f}"
    critical = f" ({row.critical} critical)" if row.critical else ""
    return (
        str(row.id), escape(row.trainee), escape(row.scenario), when, row.outcome, "yes" if row.counts else "no",
        f"{row.time_s:.1f}", score, f"{row.errors}{critical}",
    )  # fmt: skip


def run_curve(database: str | None, trainee: str, scenario: str, rules: str, as_json: bool) -> None:
    """Print how times, scores and failures of a trainee's attempts that count have gone."""
    limits = load_rules(rules).cusum
    with Store(database) as store:
        rows = [row for row in store.listed(trainee, scenario) if row.counts]
    if not rows:
        raise UnknownError(f"{trainee!r} has no attempt at {scenario!r} that counts")
    chart = cusum([row.outcome != "success" for row in rows], limits)
    times = [row.time_s for row in rows]
    fitted = learning_curve(times)
    if as_json:
        print(
            msgspec.json.encode(
                {"time_s": times, "total": [row.total for row in rows], "learning": fitted, "cusum": chart}
            ).decode()
        )
        return
    table = Table(box=None, pad_edge=False)
    for title in ("attempt", "time, s", "score", "outcome", "CUSUM"):
        table.add_column(title, justify="right")
    for row, value in zip(rows, chart.values, strict=True):
        table.add_row(str(row.id), f"{row.time_s:.1f}", f"{row.total or 0.0:.0f}", row.outcome, f"{value:+.2f}")
    console = Console(highlight=False)
    console.print(table)
    if fitted is not None:
        console.print(f"times tend to {fitted.plateau:.1f} s (power law of practice, exponent {fitted.rate:.2f})")
    console.print(f"CUSUM: acceptable below {chart.clear:+.2f}, not acceptable above {chart.alarm:+.2f}")


def run_export(database: str | None, trainee: str | None, out: Path | None) -> None:
    """Write everything that is known of a trainee, or of all, as JSON; into a file called .csv a table of metrics."""
    targets.look_at_file("--out", out)
    with Store(database) as store:
        data = store.table(trainee).encode() if out and out.suffix == ".csv" else store.export(trainee)
    if out is None:
        print(data.decode(), end="")
        return
    with targets.writing("--out", out), atomic_file(out) as half:
        half.write_bytes(data)
    print(out)


def run_erase(database: str | None, trainee: str, recordings: bool, as_json: bool) -> None:
    """Forget a trainee and all attempts, and with `recordings` the files that they were judged by."""
    with Store(database) as store:
        left = store.erase(trainee)
    if recordings:
        for path in left:
            path.unlink()
    if as_json:
        print(json.dumps({"erased": trainee, "recordings": list(map(str, left)), "recordings_erased": recordings}))
        return
    print(f"{trainee}: erased")
    for path in left:
        print(f"{'erased' if recordings else 'still there'}: {path}")
