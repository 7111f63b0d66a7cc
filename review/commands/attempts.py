"""``trocar attempts``: what was kept of trainees: listed, drawn, exported, erased."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.review.attempts.curve import cusum, learning_curve
from trocar.review.attempts.statements import Endpoint, as_lines, check_endpoint, statement
from trocar.review.attempts.store.attempts import Listed, Store, StoreError, UnknownError
from trocar.review.attempts.store.recordings import Erased, Plan
from trocar.services.cli import targets
from trocar.services.files.atomic_file import atomic_file
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.score import load_rules


def run_list(database: str | None, trainee: str | None, scenario: str | None, as_json: bool) -> None:
    """Print the attempts, oldest first."""
    with reading(database) as store:
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
    console.print(f"{_counted(len(rows), 'attempt')}; `trocar report NUMBER` shows one")


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
    with reading(database) as store:
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
    with reading(database) as store:
        data = store.table(trainee).encode() if out and out.suffix == ".csv" else store.export(trainee)
    if out is None:
        print(data.decode(), end="")
        return
    with targets.writing("--out", out), atomic_file(out) as half:
        half.write_bytes(data)
    print(out)


def run_xapi(database: str | None, trainee: str | None, to: str, home: str, login: str) -> None:
    """Send the attempts of a trainee, or of all, as xAPI statements to a learning record store or into a file.

    Raises ConfigError if `to` or `home` is an address of another kind, UserError if the store refuses them or is not
    reached.
    """
    scheme = to.partition("://")[0].lower() if "://" in to else ""
    if scheme not in ("", "http", "https"):
        raise ConfigError(f"--to {to}: is neither a file nor an http or https address")
    if scheme:
        check_endpoint(to)
    if not home.startswith(("http://", "https://")):
        raise ConfigError(f"--home {home}: is no http or https address")
    with reading(database) as store:
        statements = [statement(found, who, home.rstrip("/")) for who, found in store.kept(trainee)]
    if scheme:
        Endpoint(to, login).send(statements)
    else:
        out = Path(to)
        targets.look_at_file("--to", out)
        with targets.writing("--to", out), atomic_file(out) as half:
            half.write_bytes(as_lines(statements))
    print(f"{to}: {_counted(len(statements), 'attempt')}")


def reading(database: str | None) -> Store:
    """Return a database that must be there; what cannot be read of it is told on standard error."""
    return Store(database, create=False, tell=lambda sentence: print(f"trocar: {sentence}", file=sys.stderr))


def run_erase(database: str | None, trainee: str, recordings: bool, yes: bool, as_json: bool) -> None:
    """Forget a trainee and all attempts, and with `recordings` the files that they were judged by, once it is agreed.

    Raises StoreError: nobody can be asked, or recordings could not be removed.
    """
    with reading(database) as store:
        if not yes:
            _ask_person(store.plan_erasure(trainee), recordings)
        if recordings:
            _say_erased(store.erase_with_recordings(trainee), as_json)
        else:
            _say_forgotten(trainee, store.erase(trainee), as_json)


def _ask_person(plan: Plan, recordings: bool) -> None:
    """Say what would go, and ask. Raises StoreError if nobody is there to answer, or the answer is no."""
    if not sys.stdin.isatty():
        raise StoreError(f"erasing {plan.trainee} cannot be undone, and nobody is here to be asked: --yes goes on")
    typer.echo(f"{plan.trainee}: {_counted(plan.attempts, 'attempt')}", err=True)
    for path in plan.own:
        typer.echo(f"{'will be removed' if recordings else 'stays'}: {path}", err=True)
    for path, names in plan.shared.items():
        typer.echo(_shared(path, names), err=True)
    for path in plan.missing:
        typer.echo(_missing(path), err=True)
    if not typer.confirm("Erase for good?", err=True):
        raise StoreError("nothing is erased")


def _say_forgotten(trainee: str, left: Sequence[Path], as_json: bool) -> None:
    if as_json:
        print(json.dumps({"erased": trainee, "recordings": list(map(str, left)), "recordings_erased": False}))
        return
    print(f"{trainee}: erased")
    for path in left:
        print(f"still there: {path}")


def _say_erased(erased: Erased, as_json: bool) -> None:
    if as_json:
        print(json.dumps(_data(erased)))
    else:
        print(f"{erased.trainee}: {_counted(erased.attempts, 'attempt')} erased")
        for path, links in erased.removed.items():
            print(f"erased: {path}" + (f"; {_counted(links, 'other name')} (hard links) of it stay" if links else ""))
        for path, names in erased.shared.items():
            print(_shared(path, names))
        for path in erased.missing:
            print(_missing(path))
    if erased.failed:
        why = "; ".join(f"{path}: {reason}" for path, reason in erased.failed.items())
        raise StoreError(
            f"{_counted(erased.left, 'attempt')} of {erased.trainee} stay, as recordings could not be removed: {why}; "
            "say it again once they can, or without --recordings"
        )


def _data(erased: Erased) -> dict[str, object]:
    return {
        "erased": erased.trainee,
        "attempts": erased.attempts,
        "left": erased.left,
        "recordings": list(map(str, erased.removed)),
        "recordings_erased": not erased.failed,
        "shared": {str(path): names for path, names in erased.shared.items()},
        "missing": list(map(str, erased.missing)),
        "failed": {str(path): reason for path, reason in erased.failed.items()},
    }


def _shared(path: Path, names: Sequence[str]) -> str:
    return f"stays whole, as it also holds attempts of {', '.join(names)}: {path}"


def _missing(path: Path) -> str:
    return f"is not there any more, moved or removed before: {path}"


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
