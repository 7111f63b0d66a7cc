"""A run as a page of the documentation: figures, tables, and what they mean in words."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from trocar.services.files.atomic_file import atomic_file
from trocar.studies.accuracy.costs import FLOOR
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.frontier import ROUNDING, frontier
from trocar.studies.accuracy.sections import read_section, write_section
from trocar.studies.accuracy.study import Row, load_study, study_names

BUDGET_US = 500.0
"""Of a millisecond: what a tick may take when a core is shared with other loops and sometimes interrupted."""
SLOWER = 2.0
USELESS_PERCENT = 100.0
"""The error of a hand that feels nothing at all."""
_OF_ONE_BODY = ("integrator",)
"""Studies that time a part of a tick."""
_BESIDE = f"{FLOOR}: "
"""Begins the line of what a study was made with that says what the fixed arithmetic cost beside it."""

_INTRODUCTION = [
    "# What accuracy costs in time",
    "",
    "Made by `trocar study ... --report`; do not edit by hand. A run also writes an interactive page, and the table",
    "as CSV.",
    "",
    "- **Cost** is the time of one millisecond of the scene, in microseconds: the median ± the noise, which is half",
    "  the range of the medians of eight repeats. All settings of a study are timed in turns. Compare costs within a",
    "  study only.",
    "- **Fixed arithmetic** is the same small computation beside every study: it shows how fast the machine was.",
    "- **Error** is the distance from the reference that each section names.",
    "- **Bold**, and a ring in the figure, mark the frontier: no other setting of the study is both cheaper and more",
    f"  accurate. Costs that differ by less than the noise count as equal, and so do errors below {ROUNDING:g}.",
    "",
    "The same cases beside MuJoCo and PyElastica: [benchmarks/results/peers.md](../../benchmarks/results/peers.md).",
    "",
]


def write_report(rows: Sequence[Row], names: Sequence[str], facts: Facts, figures: Path, path: Path) -> None:
    """Write the page to ``path``, and beside it, in a folder of its name, what it is made of.

    Those are the rows of each study and the figures that lie in ``figures``. Studies of the folder that are not among
    ``names`` stay as they are, with what they were made with.
    Raises ValueError if the folder holds a study that cannot be read.
    """
    folder = path.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        with atomic_file(folder / f"{name}.svg") as half:
            shutil.copyfile(figures / f"{name}.svg", half)
        own = replace(facts, floors={k: floor for k, floor in facts.floors.items() if k == name})
        write_section([row for row in rows if row.study == name], own, folder / f"{name}.json")
    with atomic_file(path) as half:
        half.write_text(page_of(folder), encoding="utf-8")


def page_of(folder: Path) -> str:
    """Return the page that the studies of a folder make up.

    Raises ValueError if the folder holds a study that cannot be read.
    """
    files = {name: folder / f"{name}.json" for name in study_names()}
    sections = {name: read_section(file) for name, file in files.items() if file.exists()}
    common = _common_facts([section.made_with for section in sections.values()])
    told = {name: [line for line in each.made_with if line not in common] for name, each in sections.items()}
    beside = [line.removeprefix(_BESIDE) for each in told.values() for line in each if line.startswith(_BESIDE)]
    lines = [*_INTRODUCTION, *(f"- {line}" for line in common)]
    lines += [f"- {_BESIDE}{', '.join(floor.partition(' (')[0] for floor in beside)}", ""] if beside else [""]
    for name, section in sections.items():
        made_with = [line for line in told[name] if not line.startswith(_BESIDE)]
        lines += _study(name, section.rows, folder.name, made_with)
    lines += slower_machine([row for section in sections.values() for row in section.rows])
    return "\n".join(lines).rstrip() + "\n"


def _common_facts(made_with: Sequence[Sequence[str]]) -> list[str]:
    """Return what all studies were made with, if there is more than one."""
    first = made_with[0] if len(made_with) > 1 else ()
    return [line for line in first if all(line in lines for lines in made_with)]


def _study(name: str, rows: Sequence[Row], folder: str, made_with: Sequence[str]) -> list[str]:
    study = load_study(name)
    tabled = {row.setting for row in rows}  # what is said of one setting alone is in its line of the table
    told = [f"- {line}" for line in findings_of(name, rows) if line.partition(":")[0] not in tabled]
    return [
        f"## {study.TITLE}",
        "",
        study.WHAT,
        "",
        *told,
        *([""] if told else []),
        f"![{name}]({folder}/{name}.svg)",
        "",
        *_tables(name, rows),
        "",
        *(f"- {line}" for line in made_with),
        *([] if any(row.cost for row in rows) else ["- Not timed: the run was ended before."]),
        "",
    ]


def _tables(name: str, rows: Sequence[Row]) -> list[str]:
    """Return the tables of a study: settings with the same quantities share one.

    Series that are drawn only have a line that says so.
    """
    drawn: Mapping[str, str] = getattr(load_study(name), "DRAWN_ONLY", {})
    tabled = [row for row in rows if row.series not in drawn]
    quantities = {row.setting: tuple(r.quantity for r in tabled if r.setting == row.setting) for row in tabled}
    lines: list[str] = []
    for shared in dict.fromkeys(quantities.values()):
        lines += [*([""] if lines else []), *table([row for row in tabled if quantities[row.setting] == shared])]
    for series, title in drawn.items():
        count = len({row.setting for row in rows if row.series == series})
        if count:
            lines += [
                "",
                f"{title} ({count}): in the figure, and every number in `{name}.json` of the figures' folder.",
            ]
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
        f"| setting | {' | '.join(f'{q} [{units[q]}]' for q in quantities)} | us ± noise |",
        "| --- |" + " --- |" * (len(quantities) + 1),
    ]
    for setting in dict.fromkeys(row.setting for row in rows):
        mine = {row.quantity: row for row in rows if row.setting == setting}
        cells = [shown(mine[q], is_bold=id(mine[q]) in best) if q in mine else "" for q in quantities]
        cost = next(iter(mine.values())).cost
        told = "±".join(map(microseconds, (cost.median_us, cost.noise_us))) if cost else ""
        lines.append(f"| {setting} | {' | '.join([*cells, told])} |")
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
        "## Which setting to choose on a machine twice as slow",
        "",
        f"The best setting is the one with the least error whose tick stays within {BUDGET_US:.0f} us; of equal "
        f"errors, the cheapest. A setting that is {USELESS_PERCENT:.0f} % off in anything is left out. Where "
        f"everything takes {SLOWER:g} times as long, the best setting is another one only in these cases:",
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
        here, there = _choice(mine, 1.0), _choice(mine, SLOWER)
        if frontier(mine) and here != there:
            lines.append(f"| {place[0]} | {place[1]} | {_told(here, 1.0)} | {_told(there, SLOWER)} |")
    return [*lines, ""]


def _choice(rows: Sequence[Row], slower: float) -> Row | None:
    fits = frontier([row for row in rows if row.cost and slower * row.cost.median_us <= BUDGET_US])
    return min(fits, key=lambda each: max(each.error, ROUNDING), default=None)


def _told(row: Row | None, slower: float) -> str:
    if row is None or row.cost is None:
        return "none | |"
    return f"{row.setting} | {number(row.error)} {row.unit} | {microseconds(slower * row.cost.median_us)}"


def values(rows: Sequence[Row], quantity: str) -> Mapping[str, float]:
    """Return the errors of one quantity by setting: for findings."""
    return {row.setting: row.error for row in rows if row.quantity == quantity}


def costs_us(rows: Sequence[Row]) -> Mapping[str, float]:
    """Return the median costs by setting."""
    return {row.setting: row.cost.median_us for row in rows if row.cost is not None}
