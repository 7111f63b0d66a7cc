"""``trocar study``: what accuracy costs in time, as tables, figures and one page."""

from __future__ import annotations

import json
import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from trocar.services.cli import targets

# Keeps linear algebra to one thread before numpy is loaded, here and in the workers: sums are taken in one order.
from trocar.services.files.atomic_file import atomic_file
from trocar.services.messages.first_sentence import first_sentence
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.errors import ConfigError
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.figures import draw_study
from trocar.studies.accuracy.log import StudyLog
from trocar.studies.accuracy.page import Text, held_figure, write_page
from trocar.studies.accuracy.report import findings_of, microseconds, page_of, write_report
from trocar.studies.accuracy.run import fill_costs, fill_errors, floors, table
from trocar.studies.accuracy.study import Draw, Row, Size, load_study, study_names
from trocar.studies.accuracy.table import frontier_rows, write_table
from trocar.studies.accuracy.workers import open_workers
from trocar.studies.commands.progress_bar import progress_line
from trocar.studies.provenance import code_version

EVERY = "all"


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    names: tuple[str, ...]
    size: Size
    seed: int
    out: Path
    jobs: int | None
    scheduler: str | None
    report: Path | None
    json: bool

    @property
    def command(self) -> str:
        """What a person types to have the same again."""
        size = {Size.FULL: [], Size.QUICK: ["--quick"], Size.SMALLEST: ["--smallest"]}[self.size]
        return shlex.join(["trocar", "study", *self.names, *size, "--seed", str(self.seed)])


def run_study(request: Request) -> None:
    """Run studies and write table, figures and page into the folder; without a name, list what there is.

    Raises ConfigError: an unknown study, a folder with results of something else, or a scheduler that does not answer.
    """
    if not request.names:
        _list(request.json)
        return
    names = _chosen(request.names)
    if request.report is not None:
        _look_at_report(request.report)
    targets.make_folder("--out", request.out)
    draw, code = Draw(request.size, request.seed), code_version(Path(__file__).parents[2])
    try:
        log = StudyLog(request.out, draw, code)
    except ValueError as error:
        raise ConfigError(f"--out {error}") from None
    with progress_line() as tell:
        try:
            with open_workers(request.jobs or os.cpu_count() or 1, request.scheduler) as workers:
                fill_errors(names, draw, log, workers, tell)
        except ConnectionError as error:
            raise ConfigError(f"--scheduler: {error}") from None
        fill_costs(names, draw, log, tell)
    rows = table(names, draw, log)
    facts = Facts.collect(request.command, code, draw, floors(names, log))
    if request.json:
        print(json.dumps({"folder": str(request.out), **facts.as_data()}, default=str))
    else:
        _print(rows)
    with targets.writing("--out", request.out):
        write_results(rows, names, facts, request.out)
    if request.report is not None:
        with targets.writing("--report", request.report):
            write_report(rows, names, facts, request.out, request.report)
    if not request.json:
        print(f"Table, figures and page: {request.out / 'index.html'}")


def _look_at_report(report: Path) -> None:
    """Refuse a report that could not be written in the end, as when a study that lies there cannot be read."""
    folder = targets.make_figures_folder("--report", report)
    try:
        page_of(folder)
    except ValueError as error:
        raise ConfigError(f"--report {report}: {error}") from None


def write_results(rows: list[Row], names: list[str], facts: Facts, out: Path) -> None:
    """Write table, figures and page of what was found."""
    write_table(rows, out / "table.csv")
    with atomic_file(out / "run.json") as half:
        half.write_text(json.dumps(facts.as_data(), indent=1, default=str) + "\n")
    texts = {}
    for name in names:
        study, mine = load_study(name), [row for row in rows if row.study == name]
        draw_itself = getattr(study, "draw_figure", None)
        drawn = draw_itself(mine, out / name) if draw_itself else draw_study(study.TITLE, mine, out / name)
        texts[name] = Text(
            study.TITLE, study.WHAT, findings_of(name, mine), held_figure(drawn[0]) if draw_itself else ""
        )
    write_page(rows, texts, facts, out / "index.html")


def _list(as_json: bool) -> None:
    """Print every study with one sentence."""
    studies = {name: load_study(name) for name in study_names()}
    said = {name: f"{study.TITLE}: {first_sentence(study.WHAT)}" for name, study in studies.items()}
    if as_json:
        print(json.dumps({"studies": said}, indent=1))
        return
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, sentence in said.items():
        table.add_row(name, sentence)
    console = Console(highlight=False)
    console.print(table, markup=False)
    console.print(f"`trocar study NAME ...` runs some, `trocar study {EVERY}` all; --quick takes five minutes for all.")


def _chosen(wanted: tuple[str, ...]) -> list[str]:
    known = study_names()
    for name in wanted:
        if name not in (*known, EVERY):
            near = did_you_mean(name, (*known, EVERY))
            raise ConfigError(f"there is no study {name!r}; known: {', '.join(known)}, {EVERY}{near}")
    return known if EVERY in wanted else list(dict.fromkeys(wanted))


def _print(rows: list[Row]) -> None:
    """Print who is on the frontier, and in words what a study says that has none."""
    best, console = frontier_rows(rows), Console(highlight=False)
    table = Table(box=None, pad_edge=False)
    for title in ("study", "on the frontier of", "setting", "error", "us a millisecond", "99 %", "noise"):
        table.add_column(title, overflow="fold")
    for row in rows:
        if id(row) in best and row.cost is not None:
            cost = map(microseconds, (row.cost.median_us, row.cost.p99_us, row.cost.noise_us))
            table.add_row(row.study, row.quantity, row.setting, f"{row.error:.3g} {row.unit}", *cost)
    if table.row_count:
        console.print(table)
    on_frontier = {row.study for row in rows if id(row) in best}
    for name in dict.fromkeys(row.study for row in rows if row.study not in on_frontier):
        for line in findings_of(name, [row for row in rows if row.study == name]):
            console.print(f"{name}: {line}", markup=False)
