"""Tables of docs/results/haptics.md on walls beside each other: what is lost, how stiff they may be, other laws."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from trocar.studies.feel.compare import NOTICED, TRIED_N_M, Compared
from trocar.studies.feel.passivity_cost import FELT_N_M, Cost
from trocar.studies.feel.slow_hands import Slow
from trocar.studies.feel.z_width import DAMPINGS_N_S_M, ZWidth


def words(text: str) -> Iterator[str]:
    """Yield the lines of a paragraph."""
    yield from textwrap.wrap(text, width=118)


def slow_lines(found: Sequence[Slow]) -> Iterator[str]:
    """Yield the section on what slow hands lose by the bound."""
    yield ""
    yield "## What slow hands lose by the bound"
    yield ""
    yield from words(
        "Mean error of the felt force, against the wall's force at the true position of the hand, and in brackets the "
        "error without the bound. Hands press with 0.1 to 2 N at 5 to 50 mm/s; force models are 1 to 4 ms late. A "
        "person can distinguish forces that differ by 7 %."
    )
    yield ""
    walls = list(dict.fromkeys(each.walls_n_m for each in found))
    yield "| arm | " + " | ".join(f"{low:,.0f} to {high:,.0f} N/m" for low, high in walls) + " |"
    yield "| --- |" + " --- |" * len(walls)
    for arm in dict.fromkeys(each.arm for each in found):
        cells = [f"{each.law:.1%} ({each.model:.1%})" for each in found if each.arm == arm]
        yield f"| {arm} | " + " | ".join(cells) + " |"


def cost_lines(found: Sequence[Cost]) -> Iterator[str]:
    """Yield the section on what passivity costs with the delay and the friction of a real arm."""
    if not found:
        return
    yield ""
    yield "## What it costs to be passive with late forces and little friction"
    yield ""
    yield from words(
        "A force reaches the motors some time after the position that it answers; the servo is told the longest that "
        "the interface adds, and measures the rest. An arm may have less friction than its vendor tells; the servo "
        "relies on a share of it. The first row of each device has neither, as all versions before; the last has what "
        "its device file tells. Errors are those of slow hands as above, at three kinds of walls (a handle's have 20 "
        "to 60, 60 to 200 and 200 to 600 N/m at its lever), and of violent hands drawn all over the hunt's ranges, "
        "where most of the error is that of late models. The last columns are the stiffness that is felt of walls of "
        f"{' and '.join(f'{each:,.0f}' for each in FELT_N_M)} N/m, by a hand of 2,000 N/m that presses with 1 N."
    )
    yield ""
    yield "| device | delay told | friction told | soft | middle | stiff | violent | felt, N/m |"
    yield "| --- |" + " --- |" * 7
    for each in found:
        delay = "of its file" if each.told.delay_s is None else f"{1e3 * each.told.delay_s:g} ms"
        friction = "of its file" if each.told.friction is None else f"{each.told.friction:.0%}"
        slow = " | ".join(f"{error:.1%}" for error in each.slow)
        felt = ", ".join(f"{stiffness:,.0f}" for stiffness in each.felt_n_m)
        yield f"| {each.device} | {delay} | {friction} | {slow} | {each.violent:.1%} | {felt} |"


def told_lines(found: Sequence[tuple[float, Slow]]) -> Iterator[str]:
    """Yield the section on what they feel where models have another stiffness than the wall."""
    if not found:
        return
    yield ""
    yield "## A local stiffness that is not the wall's"
    yield ""
    low, high = found[0][1].walls_n_m
    yield from words(
        f"The same slow hands at walls of {low:,.0f} to {high:,.0f} N/m, where every force model has another local "
        "stiffness than the wall, by this factor. Until the next model comes, the force follows the model."
    )
    yield ""
    factors = list(dict.fromkeys(factor for factor, _ in found))
    yield "| arm | " + " | ".join(f"{each:g}" for each in factors) + " |"
    yield "| --- |" + " --- |" * len(factors)
    for arm in dict.fromkeys(each.arm for _, each in found):
        yield f"| {arm} | " + " | ".join(f"{each.law:.1%}" for _, each in found if each.arm == arm) + " |"


def z_widths_lines(found: Sequence[ZWidth]) -> Iterator[str]:
    """Yield the section on the Z-width of the arms."""
    if not found:
        return
    yield ""
    yield "## Z-width of the arms"
    yield ""
    yield from words(
        "The wall is a spring and a damper B, and nothing bounds its energy. The table gives the stiffest wall, in "
        f"N/m, of those tried up to {TRIED_N_M[-1]:,.0f} N/m, at which no hand gains energy; 0 means that each wall "
        "lets one gain. Each row after the first of an arm makes one of its properties ideal. The last columns are "
        "the borders of theory at B = 0: 2b/T by viscous friction b, and 2F/q by dry friction F and a count q. The "
        "next section has the rig's law, which bounds the energy."
    )
    yield ""
    yield "| arm | " + " | ".join(f"B = {each:g} N s/m" for each in DAMPINGS_N_S_M) + " | 2b/T | 2F/q |"
    yield "| --- |" + " --- |" * (len(DAMPINGS_N_S_M) + 2)
    for each in found:
        cells = [f"{value:,.0f}" for value in each.stiffest_n_m]
        dry = f"{each.by_dry_n_m:,.0f}" if each.by_dry_n_m < 1e6 else "no limit"
        yield f"| {each.arm}, {each.case} | " + " | ".join(cells) + f" | {each.by_viscous_n_m:,.0f} | {dry} |"


def compared_lines(found: Sequence[Compared]) -> Iterator[str]:
    """Yield the section on the rig's law beside others."""
    if not found:
        return
    arms, laws = (list(dict.fromkeys(getattr(each, name) for each in found)) for name in ("arm", "law"))
    yield ""
    yield "## Comparison with other laws"
    yield ""
    yield from words(
        "One wall is computed in the servo, with the same hands for each law (`studies/feel/laws`). For each arm the "
        f"table gives the stiffest wall, of those tried up to {TRIED_N_M[-1]:,.0f} N/m, at which no hand gains energy, "
        f"and in brackets the stiffness that is felt there, both in N/m. The last columns hold for {arms[0]} at 500 "
        "N/m: the time until the force has risen, the time until it has fallen, and the share of ticks in which its "
        f"error exceeds the {NOTICED:.0%} that a person notices."
    )
    yield ""
    yield f"| law | {' | '.join(arms)} | rise, ms | fall, ms | noticed |"
    yield "| --- |" + " --- |" * (len(arms) + 3)
    for law in laws:
        rows = [each for each in found if each.law == law]
        stiff = " | ".join(f"{each.stiffest_n_m:,.0f} ({each.rendered_n_m:,.0f})" for each in rows)
        yield f"| {law} | {stiff} | {rows[0].onset_ms:.0f} | {rows[0].loss_ms:.0f} | {rows[0].noticed:.0%} |"
