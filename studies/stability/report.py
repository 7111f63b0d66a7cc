"""The suite's results as a page: who ran, what the criteria are, the worst figure of each, and what failed."""

from __future__ import annotations

import math
import os
import platform
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import chain
from typing import Any

from trocar.services.runtime.realtime.machine import processor_name
from trocar.studies.rates import rate
from trocar.studies.stability.criteria import CRITERIA, failures, load_of, shown
from trocar.studies.stability.drawn_report import drawn_section
from trocar.studies.stability.families import FAMILIES
from trocar.studies.stability.suite import Order, Result, list_cases

PACKAGES = "numpy", "scipy", "numba"


@dataclass(frozen=True, slots=True)
class Worst:
    """The worst figure of one criterion among some results, and whose it is."""

    criterion: str
    value: float
    case: str


def worst_figures(results: Iterable[Result]) -> dict[str, Worst]:
    """Return by criterion, in the order of the table, the figure nearest to its limit or beyond it."""
    worst: dict[str, Worst] = {}
    for result in results:
        for name, value in result.figures.items():
            rank = (load_of(name, value), value)
            if name not in worst or rank > (load_of(name, worst[name].value), worst[name].value):
                worst[name] = Worst(name, value, f"{result.family}: {result.case}")
    return {name: worst[name] for name in CRITERIA if name in worst}


def page(
    order: Order, results: Sequence[Result], code: str, others: Mapping[int, Sequence[Result]] | None = None
) -> str:
    """Return the page in Markdown, with what ``others`` has of the same order, by seed."""
    by_seed = {order.seed: results, **(others or {})}
    results, seeds = list(chain(*by_seed.values())), tuple(by_seed)
    failed = [result for result in results if result.failed]
    most = "".join(
        f" --{name} {value}" for name, value in (("most", order.most), ("cases", order.cases)) if value is not None
    )
    some = () if order.families == tuple(FAMILIES) else order.families
    asked = "".join(f" --family {name}" for name in some) + f" --seed {order.seed}{most}"
    lines = [
        "# Hard cases",
        "",
        f"Written by `trocar stability --{order.reach.value}{asked}`; do not edit by hand.",
        "",
        "The suite drives scenes with hard input, such as jumps, lost ticks and thin walls. Every run is judged by the",
        "criteria of the first table; a case fails if one figure exceeds its limit. A family is a kind of input.",
        "",
        *_head(order, results, len(failed), (code, seeds)),
        "",
        *drawn_section(order, by_seed),
        "## Worst figures",
        "",
        *_criteria(results),
        "",
        "## Families",
        "",
        *_families(order, results),
        "",
        *_failed(failed),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _head(order: Order, results: Sequence[Result], failed: int, of: tuple[str, tuple[int, ...]]) -> list[str]:
    steps, seconds = sum(result.steps for result in results), sum(result.seconds for result in results)
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    code, seeds = of
    told = f"{'seeds' if len(seeds) > 1 else 'seed'} {', '.join(map(str, seeds))}"
    every = sum(len(list_cases(replace(order, seed=seed))) for seed in seeds)
    machine = f"{os.cpu_count()} cores of {processor_name()}, {platform.system()} {platform.machine()}"
    count = f"{len(results)} cases" if len(results) == every else f"{len(results)} of {every} cases run"
    snapped = sum(result.figures.get("snaps", 0.0) > 0.0 for result in results)
    return [
        f"- **{count}, {failed} failed**: {rate(failed, len(results))} of such cases fail, with 95 % confidence",
        f"- in {snapped} cases a force changed by more than its criterion in a tick; finer steps were checked",
        f"- {steps:,} steps, {seconds / 60:.0f} minutes of processor time",
        f"- code {code}, {told}, {datetime.now(UTC):%Y-%m-%d}",
        f"- {machine}, Python {platform.python_version()}, {packages}",
    ]


def _criteria(results: Sequence[Result]) -> list[str]:
    any_failed = any(result.failed for result in results)
    rows = [
        f"| criterion | limit | worst | of | cases |{' failed |' if any_failed else ''} what it is |",
        f"| --- | --- | --- | --- | --- |{' --- |' if any_failed else ''} --- |",
    ]
    for name, worst in worst_figures(results).items():
        if math.isinf(CRITERIA[name].limit):
            continue
        asked = [result for result in results if name in result.figures]
        failed = sum(name in result.failed for result in asked)
        criterion, case = CRITERIA[name], worst.case if worst.value else ""
        rows.append(
            f"| {name} | {shown(name, criterion.limit)} | {shown(name, worst.value)} | {case} | {len(asked)} |"
            f"{f' {failed} |' if any_failed else ''} {criterion.what} |"
        )
    return rows


def _families(order: Order, results: Sequence[Result]) -> list[str]:
    cases = Counter(result.family for result in results)
    failed = Counter(result.family for result in results if result.failed)
    most = max(cases.values(), default=0)
    return [
        f"No failure in {most} cases, the most of a family, still means a rate of {rate(0, most)}.",
        "",
        "| family | what | cases | failed |",
        "| --- | --- | --- | --- |",
        *(f"| {name} | {FAMILIES[name].what} | {cases[name]} | {failed[name]} |" for name in order.families),
    ]


def _failed(failed: Sequence[Result]) -> list[str]:
    if not failed:
        return ["No case failed."]
    rows = ["## Failed", "", "| family | criteria, each with its cases and the worst figure |", "| --- | --- |"]
    for family in dict.fromkeys(result.family for result in failed):
        mine = [result for result in failed if result.family == family]
        told = []
        for name, cases in sorted(Counter(name for result in mine for name in result.failed).items()):
            values = [result.figures[name] for result in mine if name in result.failed]
            told.append(f"{name} ({cases}, {shown(name, max(values, key=lambda value: load_of(name, value)))})")
        rows.append(f"| {family} | {', '.join(told)} |")
    return rows


def changes(before: Iterable[Mapping[str, Any]], results: Sequence[Result]) -> str:
    """Return what became of cases that both runs have: how many failed then and now, and which differ.

    Args:
        before: of the results that `trocar stability --json` has written
        results: sequence of Result
    """
    now = {(result.family, result.case): result.failed for result in results}
    then = {(each["family"], each["case"]): failures(each["figures"]) for each in before}
    both = [case for case in now if case in then]
    lines = [
        f"{len(both)} cases in both runs: {sum(bool(then[case]) for case in both)} failed then, "
        f"{sum(bool(now[case]) for case in both)} now"
    ]
    for family, name in both:
        was, found = then[family, name], now[family, name]
        if was != found:
            lines.append(f"{family}: {name}: {', '.join(was) or 'passed'} -> {', '.join(found) or 'passes'}")
    return "\n".join(lines)
