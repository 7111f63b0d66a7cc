"""``trocar stability``: the suite of hard cases, its progress and its table."""

from __future__ import annotations

import json
import math
import os
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from services.cli import targets
from services.runtime.errors import ConfigError, UserError
from services.studies.provenance import code_version
from services.studies.stability.families import FAMILIES
from services.studies.stability.family import Reach
from services.studies.stability.report import page, shown, worst_figures
from services.studies.stability.suite import Log, Order, Result, list_cases, run_suite


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    long: bool
    families: tuple[str, ...]
    seed: int
    jobs: int | None
    minutes: float | None
    out: Path | None
    report: Path | None
    json: bool


def run_stability(request: Request) -> None:
    """Run the suite, print its table, and end with exit code 1 if a case failed.

    Raises
    ------
    ConfigError
        An unknown family, or a folder with results of something else.
    """
    for name in request.families:
        if name not in FAMILIES:
            raise ConfigError(f"--family {name}: there is no such family; known: {', '.join(FAMILIES)}")
    targets.look_at_file("--report", request.report)
    if request.out is not None:
        targets.make_folder("--out", request.out)
    reach = Reach.LONG if request.long else Reach.QUICK
    order = Order(reach, request.seed, request.families or tuple(FAMILIES))
    code = code_version(Path(__file__).parents[2])
    with tempfile.TemporaryDirectory() as scratch:
        try:
            log = Log(request.out or Path(scratch), order, code)
        except ValueError as error:
            raise ConfigError(f"--out {error}") from None
        longest_s = math.inf if request.minutes is None else 60.0 * request.minutes
        results = _run(order, request.jobs or os.cpu_count() or 1, log, longest_s)
    if request.json:
        print(json.dumps({"code": code, "seed": order.seed, "results": [asdict(result) for result in results]}))
    else:
        _print(order, results)
    if request.report is not None:
        targets.write_text("--report", request.report, page(order, results, code))
    failed = sum(bool(result.failed) for result in results)
    if failed:
        raise UserError(f"{failed} of {len(results)} hard cases failed")


def _run(order: Order, jobs: int, log: Log, longest_s: float) -> list[Result]:
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=len(list_cases(order)))
        failed = 0

        def tell(result: Result, count: int, total: int) -> None:
            nonlocal failed
            failed += bool(result.failed)
            progress.update(task, completed=count, total=total, description=f"{failed} failed, {result.family}")

        return run_suite(order, jobs, log, tell, longest_s)


def _print(order: Order, results: list[Result]) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("family", "what", "cases", "failed", *(("worst figures beyond their limits",))):
        table.add_column(title, overflow="fold", no_wrap=title == "family")
    for name in order.families:
        mine = [result for result in results if result.family == name]
        failed = [result for result in mine if result.failed]
        beyond = {criterion for result in failed for criterion in result.failed}
        worst = [each for each in worst_figures(mine).values() if each.criterion in beyond]
        told = "\n".join(f"{each.criterion} {shown(each.criterion, each.value)}" for each in worst)
        table.add_row(name, FAMILIES[name].what, str(len(mine)), str(len(failed)), told)
    Console(highlight=False).print(table)
