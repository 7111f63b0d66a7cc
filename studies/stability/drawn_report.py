"""The page's first section: how often drawn cases fail, in what way, what those that fail have in common, and ticks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trocar.studies.rates import rate
from trocar.studies.stability.criteria import CRITERIA, load_of, shown
from trocar.studies.stability.suite import Order, Result, find_case

FAMILY = "drawn"
SEVERE = "raised", "not_finite", "tool_crossings", "crossings", "penetration_any", "healed", "dropped"


@dataclass(frozen=True, slots=True)
class Kind:
    """A way to fail, by the criteria of which one is not met."""

    name: str
    criteria: tuple[str, ...]


KINDS = (
    Kind("severe: an axis through the wall, a catheter in half of it, a state replaced, rows dropped", SEVERE),
    Kind("any overlap", (*SEVERE, "penetration_hand", "tool_penetration_hand", "tool_penetration_any")),
    Kind("energy gained, or books that do not balance", ("gain", "imbalance")),
    Kind("a force that steps, as finer steps do not", ("force_step",)),
    Kind("time withheld", ("withheld",)),
    Kind("a hand ahead of its tool", ("hand_lead",)),
    Kind("does not come to rest", ("rest", "rest_damped")),
    Kind("anything", tuple(CRITERIA)),
)


def drawn_section(order: Order, by_seed: Mapping[int, Sequence[Result]]) -> list[str]:
    """Return the section in Markdown, of the drawn cases among results by their seeds; nothing without any."""
    mine = {seed: [result for result in results if result.family == FAMILY] for seed, results in by_seed.items()}
    results = [result for of_seed in mine.values() for result in of_seed]
    if not results:
        return []
    return [
        "## Everything drawn",
        "",
        "Duct, wall, catheter, friction, effects and both hands of these cases are drawn, from all that is built and",
        f"all that hands do: {len(results)} cases. Rates are with 95 % confidence, after Clopper and Pearson.",
        "",
        *_kinds(results),
        "",
        *_ticks(results),
        "",
        *_traits(order, mine),
        "",
        *_failed(mine),
        "",
    ]


def _kinds(results: Sequence[Result]) -> list[str]:
    rows = ["| failure | cases | rate | criteria, each with its cases |", "| --- | --- | --- | --- |"]
    for kind in KINDS:
        failed = [result for result in results if _fails(result, kind.criteria)]
        counts = Counter(name for result in failed for name in result.failed if name in kind.criteria)
        told = ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))
        rows.append(f"| {kind.name} | {len(failed)} | {rate(len(failed), len(results))} | {told} |")
    return rows


def _fails(result: Result, criteria: Sequence[str]) -> bool:
    return not set(criteria).isdisjoint(result.failed)


def _ticks(results: Sequence[Result]) -> list[str]:
    """Return what a tick took, and which share of the time did not happen."""
    timed = [result for result in results if "tick_longest" in result.figures]
    if not timed:
        return []
    steps = np.array([result.steps for result in timed], np.float64)

    def share(name: str) -> float:
        of_time = np.array([result.figures.get(name, 0.0) for result in timed])
        return 100.0 * float(of_time @ steps / steps.sum())

    longest = max(timed, key=lambda result: result.figures["tick_longest"])
    median_ms = 1e3 * float(np.median([result.figures["tick_median"] for result in timed]))
    return [
        f"Of {int(steps.sum()):,} ticks {share('ticks_above_5_ms'):.2g} % took more than 5 ms of processor time and "
        f"{share('ticks_above_20_ms'):.2g} % more than 20 ms; the longest took "
        f"{1e3 * longest.figures['tick_longest']:.0f} ms ({longest.case}), the median of cases' medians is "
        f"{median_ms:.2g} ms. {share('withheld'):.2g} % of the simulated time did not happen, and hands were at most "
        f"{1e3 * max(result.figures.get('hand_lead', 0.0) for result in timed):.2g} mm ahead of their tools.",
    ]


def _traits(order: Order, by_seed: Mapping[int, Sequence[Result]]) -> list[str]:
    """Return rates of cases that have something in common: what the causes of failures are looked for in."""
    cases, severe, failed = Counter[str](), Counter[str](), Counter[str]()
    for seed, results in by_seed.items():
        for result in results:
            traits = find_case(replace(order, seed=seed), FAMILY, result.case).traits
            for trait in traits() if traits is not None else ():
                cases[trait] += 1
                severe[trait] += _fails(result, SEVERE)
                failed[trait] += bool(result.failed)
    return [
        "| of cases with | cases | severe | rate | failed | rate |",
        "| --- | --- | --- | --- | --- | --- |",
        *(
            f"| {trait} | {n} | {_counted(severe[trait], n)} | {_counted(failed[trait], n)} |"
            for trait, n in sorted(cases.items(), key=lambda each: (-severe[each[0]] / each[1], each[0]))
        ),
    ]


def _counted(failed: int, cases: int) -> str:
    return f"{failed} | {rate(failed, cases)}"


def _failed(by_seed: Mapping[int, Sequence[Result]]) -> list[str]:
    """Return every case that failed, the worst figure first."""
    lines = ["| case | seed | figures beyond their limits |", "| --- | --- | --- |"]
    for seed, results in by_seed.items():
        for result in results:
            if result.failed:
                worst = sorted(result.failed, key=lambda name: -load_of(name, result.figures[name]))
                told = ", ".join(f"{name} {shown(name, result.figures[name])}" for name in worst)
                lines.append(f"| {result.case} | {seed} | {told} |")
    return lines if len(lines) > 2 else ["No case failed."]
