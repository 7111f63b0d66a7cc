"""A run as a page of the documentation: figures, tables, and what they mean in words."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from services.studies.accuracy.facts import Facts
from services.studies.accuracy.frontier import ROUNDING, frontier
from services.studies.accuracy.sections import Section, read_section, write_section
from services.studies.accuracy.study import Row, load_study, study_names
from services.whole_file import whole_file

BUDGET_US = 500.0
"""Of a millisecond: what a tick may take when a core is shared with other loops and sometimes interrupted."""
SLOWER = 2.0
USELESS_PERCENT = 100.0
"""So far off is who feels nothing at all."""
_OF_ONE_BODY = ("integrator",)
"""Studies that time a part of a tick."""


def write_report(rows: Sequence[Row], names: Sequence[str], facts: Facts, figures: Path, path: Path) -> None:
    """Write the page to ``path``, and beside it, in a folder of its name, what it is made of.

    Those are the rows of each study and the figures that lie in ``figures``. Studies of the folder that are not among
    ``names`` stay as they are, with what they were made with.

    Raises
    ------
    ValueError
        The folder holds a study that cannot be read.
    """
    folder = path.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        with whole_file(folder / f"{name}.svg") as half:
            shutil.copyfile(figures / f"{name}.svg", half)
        own = replace(facts, floors={k: floor for k, floor in facts.floors.items() if k == name})
        write_section([row for row in rows if row.study == name], own, folder / f"{name}.json")
    files = {name: folder / f"{name}.json" for name in study_names()}
    sections = {name: read_section(file) for name, file in files.items() if file.exists()}
    lines = [
        "# What accuracy costs in time",
        "",
        "Made by `trocar study ... --report`, each part by the command that it names; not to be edited by hand. A run",
        "also makes one page on which every point can be chosen, and the whole table as CSV.",
        "",
        "A cost is that of a millisecond of the scene: median, 99 %, and as noise half the range of the medians of",
        "eight interleaved repeats. An error is against the reference that each section names. In bold, and with a",
        "ring, is what is on the frontier: no other setting of its study beats it in both. Costs that differ by no",
        f"more than the noise of both count as equal, and so do errors below {ROUNDING:g}, which are rounding: of two",
        "settings that cannot be told apart in cost the one that is more wrong is beaten, and along the frontier each",
        "step to less error costs more than noise.",
        "",
        "Settings of a study are timed in turns, so that a slow spell of the machine meets them all: noise is what",
        "counts between them. Studies, and runs, meet different spells: two runs agree on errors to the last digits,",
        "and on costs within the noise of both and how far the machine drifted in either, as fixed arithmetic beside",
        "each study tells.",
        "",
        "Beside MuJoCo and PyElastica, on cases that all of them can do and in one run, is what",
        "`python benchmarks/bench_peers.py` writes ([benchmarks/results/peers.md](../benchmarks/results/peers.md)).",
        "",
    ]
    for name, section in sections.items():
        lines += _study(name, section, folder.name)
    lines += slower_machine([row for section in sections.values() for row in section.rows])
    with whole_file(path) as half:
        half.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


def _study(name: str, section: Section, folder: str) -> list[str]:
    study, rows = load_study(name), section.rows
    told = [f"- {line}" for line in findings_of(name, rows)]
    return [
        f"## {study.TITLE}",
        "",
        study.WHAT,
        "",
        *told,
        *([""] if told else []),
        f"![{study.TITLE}]({folder}/{name}.svg)",
        "",
        *_tables(name, rows),
        "",
        *(f"- {line}" for line in section.made_with),
        *([] if any(row.cost for row in rows) else ["- not timed: the run was ended before"]),
        "",
    ]


def _tables(name: str, rows: Sequence[Row]) -> list[str]:
    """Return the table of a study, series that it wants apart folded away below."""
    apart: Mapping[str, str] = getattr(load_study(name), "TABLED_APART", {})
    lines = table([row for row in rows if row.series not in apart])
    for series, title in apart.items():
        mine = [row for row in rows if row.series == series]
        if mine:
            lines += ["", "<details>", f"<summary>{title} ({len({row.setting for row in mine})})</summary>", ""]
            lines += [*table(mine), "", "</details>"]
    return lines


def findings_of(name: str, rows: Sequence[Row]) -> list[str]:
    """Return what a study reads in its rows: nothing where it has no words for them."""
    read = getattr(load_study(name), "findings", None)
    return list(read(rows)) if read else []


def table(rows: Sequence[Row]) -> list[str]:
    """Return all settings as a table, one column a quantity; what is on a frontier is set in bold."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    units = {row.quantity: row.unit for row in rows}
    best = {id(row) for quantity in quantities for row in frontier([r for r in rows if r.quantity == quantity])}
    lines = [
        f"| setting | {' | '.join(f'{q} [{units[q]}]' for q in quantities)} | us | 99 % | noise |",
        "| --- |" + " --- |" * (len(quantities) + 3),
    ]
    for setting in dict.fromkeys(row.setting for row in rows):
        mine = {row.quantity: row for row in rows if row.setting == setting}
        cells = [shown(mine[q], is_bold=id(mine[q]) in best) if q in mine else "" for q in quantities]
        cost = next(iter(mine.values())).cost
        costs = [*map(microseconds, (cost.median_us, cost.p99_us, cost.noise_us))] if cost else [""] * 3
        lines.append(f"| {setting} | {' | '.join([*cells, *costs])} |")
    return lines


def shown(row: Row, *, is_bold: bool = False) -> str:
    """Return an error with three digits."""
    told = number(row.error)
    return f"**{told}**" if is_bold else told


def microseconds(value: float) -> str:
    """Return a time in us: whole ones from ten on, two digits below."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def number(value: float) -> str:
    """Return a value with three digits, without an exponent where that can be."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.3g}" if 1e-4 <= abs(value) < 1e5 or value == 0.0 else f"{value:.1e}"


def slower_machine(rows: Sequence[Row]) -> list[str]:
    """Return which setting to choose here, and on a machine that takes twice as long."""
    lines = [
        "## Which rung to choose on a machine twice as slow",
        "",
        f"The setting with the least error whose tick stays within {BUDGET_US:.0f} us here, and the one that does so "
        f"where everything takes {SLOWER:g} times as long; of errors that are alike the cheapest. A setting that is "
        f"{USELESS_PERCENT:.0f} % off in anything is no choice.",
        "",
        "| study | quantity | here | error | us | twice as slow | error | us there |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    useless = {
        (row.study, row.setting) for row in rows if row.is_known and row.unit == "%" and not row.error < USELESS_PERCENT
    }
    usable = [row for row in rows if row.study not in _OF_ONE_BODY and (row.study, row.setting) not in useless]
    for place in dict.fromkeys((row.study, row.quantity) for row in usable):
        mine = [row for row in usable if (row.study, row.quantity) == place]
        cells = [_choice(mine, 1.0), _choice(mine, SLOWER)]
        if frontier(mine):
            lines.append(f"| {place[0]} | {place[1]} | {cells[0]} | {cells[1]} |")
    return [*lines, ""]


def _choice(rows: Sequence[Row], slower: float) -> str:
    fits = frontier([row for row in rows if row.cost and slower * row.cost.median_us <= BUDGET_US])
    row = min(fits, key=lambda each: max(each.error, ROUNDING), default=None)
    if row is None or row.cost is None:
        return "none | |"
    return f"{row.setting} | {number(row.error)} {row.unit} | {microseconds(slower * row.cost.median_us)}"


def values(rows: Sequence[Row], quantity: str) -> Mapping[str, float]:
    """Return the errors of one quantity by setting: for findings."""
    return {row.setting: row.error for row in rows if row.quantity == quantity}


def costs_us(rows: Sequence[Row]) -> Mapping[str, float]:
    """Return the median costs by setting."""
    return {row.setting: row.cost.median_us for row in rows if row.cost is not None}
