"""docs/results/haptics.md: how good the haptics is, in words, tables and figures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.files.atomic_file import atomic_file
from trocar.studies.feel.compare import Compared
from trocar.studies.feel.hunt import MASSES_KG, Hunted
from trocar.studies.feel.late import TOOLS, WITHIN, Late
from trocar.studies.feel.measure import TABLE_HZ, WAYS, Border, Energies, Rendered
from trocar.studies.feel.passivity_cost import Cost
from trocar.studies.feel.report_tables import (
    compared_lines,
    cost_lines,
    slow_lines,
    told_lines,
    words,
    z_widths_lines,
)
from trocar.studies.feel.slow_hands import Slow
from trocar.studies.feel.tracking import WITHIN as TRACKED_WITHIN
from trocar.studies.feel.tracking import Running
from trocar.studies.feel.z_width import ZWidth, felt_shares

_MOST_LISTED = 12


@dataclass(frozen=True)
class Felt:
    """All that was found."""

    passive: Sequence[Border]
    stable: Sequence[Border]
    rendered: Sequence[Rendered]
    energies: Sequence[Energies]
    late: Sequence[Late]
    hunted: Sequence[Hunted]
    slow: Sequence[Slow]
    running: Running | None = None
    compared: Sequence[Compared] = ()
    z_widths: Sequence[ZWidth] = ()
    told: Sequence[tuple[float, Slow]] = ()
    costs: Sequence[Cost] = ()

    def worst_border(self) -> float:
        """Return the largest relative distance of a measured border from theory."""
        return max(abs(row.error) for row in (*self.passive, *self.stable))


def write_page(felt: Felt, made_with: Sequence[str], figures: Path, page: Path) -> None:
    """Write the page; `figures` is the folder of its figures, beside it."""
    with atomic_file(page) as half:
        half.write_text("\n".join(map(_tight, _lines(felt, made_with, figures.name))), encoding="utf-8")


def _tight(line: str) -> str:
    """Return a row of a table without the spaces that only align it."""
    return re.sub(r" *\| *", "|", line) if line.startswith("|") else line


def _lines(felt: Felt, made_with: Sequence[str], figures: str) -> Iterator[str]:
    yield "# What is felt"
    yield ""
    yield from words(
        "Written by `trocar haptics`; do not edit by hand. All tests run the law that writes to the devices "
        "(`services/gateway/servo/servo_law.py`). Most run it alone; a pinch and an insertion run through all processes"
        " of a rig."
    )
    yield ""
    yield from (f"- {line}" for line in made_with)
    yield from _borders(felt, figures)
    yield from _transparency(felt.rendered, figures)
    yield from _running(felt.running, made_with)
    yield from _late(felt.late)
    yield from _energies(felt.energies, figures)
    yield from _hunted(felt.hunted)
    yield from slow_lines(felt.slow)
    yield from cost_lines(felt.costs)
    yield from told_lines(felt.told)
    yield from z_widths_lines(felt.z_widths)
    yield from compared_lines(felt.compared)
    yield ""


def _borders(felt: Felt, figures: str) -> Iterator[str]:
    yield ""
    yield "## How stiff a wall may be"
    yield ""
    yield from words(
        "A wall that is computed once every T and held in between gives energy to the hand that touches it; the "
        "friction of the device has to absorb that energy. The wall (stiffness K, damping B, with a delay t of "
        "the loop) is passive with any hand if the friction is b > K(T/2 + t) + |B| (Colgate and Schenkel). It is"
        " stable without a hand if b + B > K(T/2 + t) (Gil and others). The largest distance between measurement "
        f"and theory is **{100.0 * felt.worst_border():.1f} %**."
    )
    yield ""
    yield f"![Borders]({figures}/borders.svg)"
    yield ""
    yield from words(
        "They differ most at long delays, where K (T/2 + t)^2 is not small compared with the mass. Here nothing "
        "bounds the energy; with the bound, a wall that is too stiff gives back at most what was put in."
    )
    yield ""
    yield "| a wall of 500 N/m, servo at 1 kHz, force | needs a friction of, N s/m | measured |"
    yield "| --- | --- | --- |"
    for row in felt.passive:
        if row.wall.stiffness_n_m == 500.0 and not row.wall.damping_n_s_m:
            way = f"over the bus, {row.wall.delay} ms late" if row.wall.delay else "by a local model, however late"
            yield f"| {way} | {row.theory:.2f} | {row.measured:.2f} |"
    yield ""
    yield from words(
        "The table has B = 0. A Phantom Premium has a friction of about 0.05 N s/m and 0.04 N; a hand adds 1 to "
        "10 N s/m."
    )
    yield ""
    yield from words(
        "A local model is evaluated at the present position of the hand. If it arrives late, the wall is where "
        "the tissue was then; that puts no energy into the loop. This is why the servo gets a model and not a "
        "force."
    )


def _transparency(rendered: Sequence[Rendered], figures: str) -> Iterator[str]:
    hertz = [each for each in TABLE_HZ if any(row.frequency_hz == each for row in rendered)]
    yield ""
    yield "## What a moving hand feels"
    yield ""
    yield from words(
        "A hand moves in a wall of 500 N/m sinusoidally at 1 to 100 Hz. The table gives the phase lag of the force "
        "behind the position, in degrees. A spring has 0. Between 0 and 180 the wall gives energy in every cycle; at "
        "180 it attracts the hand."
    )
    yield ""
    yield "| force | " + " | ".join(f"{each:g} Hz" for each in hertz) + " |"
    yield "| --- |" + " --- |" * len(hertz)
    for name, _ in WAYS:
        cells = [f"{row.late_deg:.0f}" for row in rendered if row.way == name and row.frequency_hz in hertz]
        yield f"| {name} | " + " | ".join(cells) + " |"
    yield ""
    yield "The force over the bus with 1 ms is the paper's way: one loop computes a penalty force and sends it."
    yield ""
    yield f"![Transparency]({figures}/transparency.svg)"
    yield ""
    yield from words(
        "A moving hand also moves the arm. With the arm's mass m it feels K - m (2 pi f)^2 of the wall's stiffness K. "
        "The table gives this as a share of 500 N/m; below zero the hand feels the mass and not the wall."
    )
    yield ""
    yield "| arm | " + " | ".join(f"{each:g} Hz" for each in hertz) + " |"
    yield "| --- |" + " --- |" * len(hertz)
    for arm, mass_kg in MASSES_KG.items():
        cells = [f"{share:.0%}" for share in felt_shares(arm, 500.0, hertz)]
        yield f"| {arm}, {mass_kg:g} kg | " + " | ".join(cells) + " |"


def _running(running: Running | None, made_with: Sequence[str]) -> Iterator[str]:
    yield ""
    yield "## A pinch and an insertion through the running processes"
    yield ""
    if running is None:
        yield "Not measured: `trocar haptics --running` starts a rig of its own for it."
        return
    pinch = running.pinch
    yield from words(
        "In a rig with simulated arms, drives and encoders, one hand pinches the duct's wall and the other slides the "
        "catheter 20 mm into it."
    )
    yield ""
    yield from (f"- {line}" for line in running.made_with if line not in made_with)
    yield f"- {running.ticks:,} ticks, {running.lost} of them lost by the rig or by its observer"
    yield ""
    yield from words(
        "**The pinch**, at rest, before the catheter touches the duct: the force on the forceps is "
        f"{1e3 * pinch.force_n:.1f} mN. Under the same loads the displacement of the unreduced finite elements differs "
        f"by **{100.0 * pinch.wall:+.1f} %** from that of the rig's wall, measured by the work of the loads (limit: "
        "2 %). The wall is linear, so the force at a given indentation has the same error. The force that the arm "
        f"applies differs by **{pinch.applied:.1%}** from the solved one."
    )
    yield ""
    yield from _insertion_beside(running)


def _insertion_beside(running: Running) -> Iterator[str]:
    yield from words(
        "**The insertion**, compared tick by tick with the mechanics alone at the same poses. Errors are in per cent "
        "of each tool's largest force. The force that the arm applies is compared two ticks later, because it passes "
        "through haptics and physics and is applied in the next tick."
    )
    yield ""
    yield f"| force on the hand | ticks within {TRACKED_WITHIN:.0%} | worst |"
    yield "| --- | --- | --- |"
    for row in running.apart:
        yield f"| {row.tool}, {row.what} | {row.within:.1%} | {row.worst:.1%} |"
    yield ""
    yield from words(
        "Two runs do not agree where the jaws slip on the duct, because the slip depends on rounding. Along the wall, "
        "where friction holds, each count of the arm's encoder is felt. After lost ticks the hand has moved on, and "
        "meets the model's stiffness at once."
    )


def _late(rows: Sequence[Late]) -> Iterator[str]:
    yield ""
    yield "## An insertion with delayed force models"
    yield ""
    yield from words(
        "The same motions without encoders. Normally a tick's model reaches the servo in the next tick; the first "
        "column is the additional delay, equal for all models or random for each. Each other cell gives the share of "
        f"ticks in which the error of the force is below {WITHIN:.0%}, and the largest error, both relative to the "
        "largest force. A model older than 5 ms fades and one of 20 ms is unused, so late models leave a limp hand on "
        "purpose (an error of 100 %). *Force alone* holds the last force instead, as in the paper."
    )
    yield ""
    yield (
        "| added, ms | "
        + " | ".join(f"{tool}, {way}" for tool in TOOLS for way in ("local model", "force alone"))
        + " |"
    )
    yield "| --- |" + " --- |" * (2 * len(TOOLS))
    for added, jitter in dict.fromkeys((row.added_ms, row.jitter_ms) for row in rows):
        cells = [
            f"{np.mean(apart < WITHIN):.1%}, {apart.max():.1%}"
            for row in rows
            if (row.added_ms, row.jitter_ms) == (added, jitter)
            for apart in (row.local, row.force_alone)
        ]
        yield f"| {f'0 to {jitter}' if jitter else added} | " + " | ".join(cells) + " |"
    yield ""
    yield from words(
        "With hands as slow as these, a held force has the smaller error. But it feeds energy into the arm (see the "
        "sections above and below), and never ends."
    )


def _energies(found: Sequence[Energies], figures: str) -> Iterator[str]:
    count = len(found[0].books)
    yield ""
    yield "## Hands that try to gain energy"
    yield ""
    yield from words(
        f"{count} hands at one wall each, the same for every row. Walls have 30 to 5,000 N/m; force models are 1 to 19 "
        "ms late, and up to half of them are lost; hands move 0.1 to 6 mm at 0.5 to 100 Hz. Half of the hands are "
        "stiff while the wall pushes and soft while it is pushed. Between hand and wall is the simulated Premium with "
        "its encoders, friction and motors. A hand has gained energy if, after it has left the wall, the motors have "
        "done more work on the joints than friction took."
    )
    yield ""
    yield "| | hands that gained | largest gain | servo alone gave energy |"
    yield "| --- | --- | --- | --- |"
    for each in found:
        worst = f"{1e3 * each.worst_j:.2f} mJ" if each.worst_j > 0.0 else "nothing"
        yield f"| {each.kind} | **{each.gaining}** of {count} | {worst} | {each.servo_gaining} times |"
    yield ""
    yield from words(
        "The last column leaves out the arm's own friction. Encoders and the held force give a little energy, which "
        "this friction absorbs. A bound that removed it, too, would add more noise than it removes."
    )
    yield ""
    yield from _gaining(found[0])
    yield f"![Energies]({figures}/energies.svg)"


def _hunted(found: Sequence[Hunted]) -> Iterator[str]:
    yield ""
    yield from words(
        "An optimiser (CMA-ES) searches for hands that gain energy. The devices of the device files are modelled as "
        "masses with encoders and friction, a handle on its lever; walls have up to 2,500 N/m, and force models are 1 "
        "to 20 ms late. Each hand has 0.7 to 3 times the device's mass, a grip of 3 to 20 N, a delay of its forces "
        "between nothing and what the servo is told, which jitters by any part of it from force to force, and a "
        "friction of the arm between what the servo is told and what the vendor tells. A gain is more than 1 uJ. Two "
        "linked Premiums touch one piece of tissue."
    )
    yield ""
    yield "| arm | bounded | hands | gained | most |"
    yield "| --- | --- | --- | --- | --- |"
    yield from (each.row() for each in found)


def _gaining(first: Energies) -> Iterator[str]:
    """List the hands that got energy out of the servo as the rig runs it."""
    got = sorted(zip(first.attacks, first.books, strict=True), key=lambda each: -each[1].gained_j)
    got = [each for each in got if each[1].gained_j > 0.0]
    if not got:
        return
    yield from words("The hands that gained energy from the servo as the rig runs it, the worst first.")
    yield ""
    yield "| wall, N/m | answers late, ms | lost | hand: Hz | mm | m/s | got, mJ | of, mJ |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for attack, book in got[:_MOST_LISTED]:
        speed_m_s = 2.0 * math.pi * attack.hertz * attack.depth_m
        yield (
            f"| {attack.stiffness_n_m:.0f} | {attack.bus_delay} | {attack.lost:.0%} | {attack.hertz:.1f} "
            f"| {1e3 * attack.depth_m:.1f} | {speed_m_s:.2f} | {1e3 * book.gained_j:.2f} | {1e3 * book.moved_j:.0f} |"
        )
    yield ""
