"""``trocar stability``: the suite of hard cases, its progress and its table."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from trocar.services.cli import targets
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.errors import ConfigError, UserError
from trocar.studies.commands.progress_bar import progress_line
from trocar.studies.provenance import code_version
from trocar.studies.stability.criteria import shown
from trocar.studies.stability.families import FAMILIES
from trocar.studies.stability.family import Reach
from trocar.studies.stability.report import changes, page, worst_figures
from trocar.studies.stability.suite import Log, Order, Result, list_cases, run_suite


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    long: bool
    families: tuple[str, ...]
    seed: int
    most: int | None
    cases: int | None
    jobs: int | None
    minutes: float | None
    out: Path | None
    report: Path | None
    others: tuple[Path, ...]
    against: Path | None
    json: bool


def run_stability(request: Request) -> None:
    """Run the suite, print its table, and end with exit code 1 if a case failed.

    Raises ConfigError if an unknown family, a folder with results of something else, or a file that holds no results.
    """
    for name in request.families:
        if name not in FAMILIES:
            near = did_you_mean(name, FAMILIES)
            raise ConfigError(f"--family {name}: there is no such family; known: {', '.join(FAMILIES)}{near}")
    targets.look_at_file("--report", request.report, makes_folder=True)
    if request.out is not None:
        targets.make_folder("--out", request.out)
    before = _results_of(request.against) if request.against is not None else None
    reach = Reach.LONG if request.long else Reach.QUICK
    order = Order(reach, request.seed, request.families or tuple(FAMILIES), request.most, request.cases)
    code = code_version(Path(__file__).parents[2])
    with tempfile.TemporaryDirectory() as scratch:
        try:
            log = Log(request.out or Path(scratch), order, code)
        except ValueError as error:
            raise ConfigError(f"--out {error}") from None
        longest_s = math.inf if request.minutes is None else 60.0 * request.minutes
        others = _others(request.others, order, code)
        results = _run(order, request.jobs or os.cpu_count() or 1, log, longest_s)
    if request.json:
        told = [asdict(result) | {"failed": result.failed} for result in results]
        print(json.dumps({"code": code, "seed": order.seed, "results": told}))
    else:
        _print(order, results)
    if before is not None:
        print(changes(before, results), file=sys.stderr if request.json else sys.stdout)
    if request.report is not None:
        targets.write_text("--report", request.report, page(order, results, code, others))
    failed = sum(bool(result.failed) for result in results)
    if failed:
        raise UserError(f"{failed} of {len(results)} hard cases failed")


def _others(folders: tuple[Path, ...], order: Order, code: str) -> dict[int, list[Result]]:
    """Read what the same order has left with other seeds, by seed."""
    found: dict[int, list[Result]] = {}
    for folder in folders:
        try:
            seed = int(json.loads((folder / "order.json").read_text())["seed"])
            found[seed] = Log(folder, replace(order, seed=seed), code).results
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"--and {folder}: holds no results of this order and code ({error})") from None
    return found


def _results_of(file: Path) -> list[dict[str, Any]]:
    """Read what a run with --json has written."""
    try:
        results: list[dict[str, Any]] = json.loads(file.read_text())["results"]
        changes(results, [])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"--against {file}: holds no results of `trocar stability --json` ({error})") from None
    return results


def _run(order: Order, jobs: int, log: Log, longest_s: float) -> list[Result]:
    failed = 0
    with progress_line() as say:
        say("cases", len(log.results), len(list_cases(order)))

        def tell(result: Result, count: int, total: int) -> None:
            nonlocal failed
            failed += bool(result.failed)
            say(f"cases, {failed} failed, {result.family}", count, total)

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
