"""docs/haptics.md: how good the haptics is, in words, tables and figures."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from services.gateway.feel.late import TOOLS, WITHIN, Late
from services.gateway.feel.measure import TABLE_HZ, WAYS, Border, Energies, Rendered
from services.gateway.feel.tracking import WITHIN as TRACKED_WITHIN
from services.gateway.feel.tracking import Running
from services.whole_file import whole_file

_MOST_LISTED = 12


@dataclass(frozen=True)
class Felt:
    """All that was found."""

    passive: Sequence[Border]
    stable: Sequence[Border]
    rendered: Sequence[Rendered]
    energies: Sequence[Energies]
    late: Sequence[Late]
    running: Running | None = None

    def worst_border(self) -> float:
        """Return the largest relative distance of a measured border from theory."""
        return max(abs(row.error) for row in (*self.passive, *self.stable))


def write_page(felt: Felt, made_with: Sequence[str], figures: Path, page: Path) -> None:
    """Write the page; `figures` is the folder of its figures, beside it."""
    with whole_file(page) as half:
        half.write_text("\n".join(_lines(felt, made_with, figures.name)), encoding="utf-8")


def _lines(felt: Felt, made_with: Sequence[str], figures: str) -> Iterator[str]:
    yield "# What is felt"
    yield ""
    yield from _words(
        "Written by `trocar haptics`; not to be edited by hand. Everything here runs the servo's own law "
        "(`services/gateway/servo_law.py`), the one that writes to the devices; most of it function by function, and a "
        "pinch and an insertion through all processes of a rig."
    )
    yield ""
    yield from (f"- {line}" for line in made_with)
    yield from _borders(felt, figures)
    yield from _transparency(felt.rendered, figures)
    yield from _running(felt.running)
    yield from _late(felt.late)
    yield from _energies(felt.energies, figures)
    yield ""


def _words(text: str) -> Iterator[str]:
    yield from textwrap.wrap(text, width=118)


def _borders(felt: Felt, figures: str) -> Iterator[str]:
    yield ""
    yield "## How stiff a wall may be"
    yield ""
    yield from _words(
        "A wall that is computed T apart and held between gives energy to whoever touches it; the friction of "
        "the device has to take it. Passive with any hand: b > KT/2 + |B|, with a delay of the loop b > K(T/2 "
        "+ t) + |B| (Colgate and Schenkel). Stable by itself: b + B > K(T/2 + t) (Gil and others). The "
        f"largest distance of what was measured from theory is **{100.0 * felt.worst_border():.1f} %**."
    )
    yield ""
    yield f"![Borders]({figures}/borders.svg)"
    yield ""
    yield from _words(
        "The hardest to meet are long delays: stability theory holds while K (T/2 + t)^2 is small beside the "
        "mass, and a wall is a little more stable than it says. With the passivity controller a wall that is too "
        "stiff does not run away: it hums at the 10 mm/s below which the controller is silent, 0.07 mm at 1,500 N/m."
    )
    yield ""
    yield "| a wall of 500 N/m, servo at 1 kHz, force | needs a friction of, N s/m | measured |"
    yield "| --- | --- | --- |"
    for row in felt.passive:
        if row.wall.stiffness_n_m == 500.0 and not row.wall.damping_n_s_m:
            way = f"over the bus, {row.wall.delay} ms late" if row.wall.delay else "by a local model, however late"
            yield f"| {way} | {row.theory:.2f} | {row.measured:.2f} |"
    yield ""
    yield from _words(
        "With a delay and damping together theory is a bound, not a border: the wall with B = 0 is compared "
        "here. A Phantom Premium has the friction of about 0.05 N s/m and 0.04 N, a hand adds 1 to 10 N s/m."
    )
    yield ""
    yield from _words(
        "A local model is evaluated against the present position, so how late it came moves the wall by what "
        "the tissue did since then, and puts no energy into the loop. That is what the design buys."
    )


def _transparency(rendered: Sequence[Rendered], figures: str) -> Iterator[str]:
    hertz = [each for each in TABLE_HZ if any(row.frequency_hz == each for row in rendered)]
    yield ""
    yield "## What a moving hand meets"
    yield ""
    yield from _words(
        "A wall of 500 N/m, moved in sinusoids of 1 to 100 Hz: how many degrees the force is behind the "
        "position. A spring is at 0; from 0 to 180 the wall gives energy in every cycle, at 90 it is no "
        "spring at all, at 180 it pulls in. Whole turns count: at 360 the force is a whole cycle late."
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


def _running(running: Running | None) -> Iterator[str]:
    yield ""
    yield "## A pinch and an insertion through the running processes"
    yield ""
    if running is None:
        yield "Not measured: `trocar haptics --running` starts a rig of its own for it."
        return
    pinch = running.pinch
    yield from _words(
        "A rig of its own, with simulated arms, drives and encoders: one hand pinches the duct's wall, the other "
        "slides the catheter 20 mm in. Every frame of gateway and physics is kept."
    )
    yield ""
    yield from (f"- {line}" for line in running.made_with)
    yield f"- {running.ticks:,} ticks, {running.lost} of them lost by the rig or by who looked on"
    yield ""
    yield from _words(
        f"**The pinch**, at rest, before the catheter touches the duct: the forceps meet {1e3 * pinch.force_n:.1f} mN. "
        "Under the loads that physics tells of, the static answer of the unreduced finite elements yields "
        f"**{100.0 * pinch.wall:+.1f} %** against the wall of the rig, by the work of the loads. The wall is linear, "
        "so the force that an indentation takes is off by as much (asked: 2 %): what the modes leave out, the residual "
        f"compliance brings back. The arm's force is **{pinch.applied:.1%}** from the solved one."
    )
    yield ""
    yield from _insertion_beside(running)


def _insertion_beside(running: Running) -> Iterator[str]:
    yield from _words(
        "**The insertion**, tick by tick, beside the same poses stepped in process without anything between, as shares "
        "of each tool's largest force. What the arm applies is looked at two ticks later: one through haptics and "
        "physics, and the next one's."
    )
    yield ""
    yield f"| force on the hand | ticks within {TRACKED_WITHIN:.0%} | worst |"
    yield "| --- | --- | --- |"
    for row in running.apart:
        yield f"| {row.tool}, {row.what} | {row.within:.1%} | {row.worst:.1%} |"
    yield ""
    yield from _words(
        "The jaws hold the duct in this scene: where they slip, how far hangs on rounding, and neither two runs nor a "
        "run and the mechanics alone agree. Where they close round the wall, haptics sees its shape of a tick ago, and "
        "along it, where friction holds, each count of the arm's encoder is felt. After ticks that were lost a hand "
        "that moved on meanwhile meets the model's stiffness at once."
    )


def _late(rows: Sequence[Late]) -> Iterator[str]:
    yield ""
    yield "## An insertion whose answers come late"
    yield ""
    yield from _words(
        "The insertion of the scenarios, stepped in process: one hand slides the catheter 20 mm into the duct, the "
        "other pinches its wall. Each tick's model is at the servo in the next; on top comes what is added to all "
        "answers, or up to so much to each by itself. How far the force on a hand is from what the mechanics solve for "
        "where it is in that tick, of the largest on it: the share of ticks within "
        f"{WITHIN:.0%}, and the worst. A model older than 5 ms fades, one of 20 ms is none, so what comes so late "
        "leaves a limp hand on purpose (100 % off); a force that is held for ever, as in the paper, goes on. No "
        "encoder is between, as there is above."
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
    yield from _words(
        "Where hands move as slowly as here, a force that is held is the nearer one: what it costs is the energy that "
        "comes out of the arm (above and below), and that it never ends."
    )


def _energies(found: Sequence[Energies], figures: str) -> Iterator[str]:
    count = len(found[0].books)
    yield ""
    yield "## Hands that try to get energy out"
    yield ""
    yield from _words(
        f"{count} hands at one wall each, the same for every row: stiffness 30 to 5,000 N/m, answers 1 to 19 "
        "ms late, none to half of them lost, motion of 0.1 to 6 mm at 0.5 to 100 Hz, half of the hands stiff "
        "while the wall pushes and soft while it is pushed. The simulated Premium with its encoders, friction "
        "and motors is between. Energy is that of the motors' torques over the joints' ways, less what the "
        "joints' friction took, after the hand has left."
    )
    yield ""
    yield "| | hands that gained | most that one got | servo alone gave |"
    yield "| --- | --- | --- | --- |"
    for each in found:
        worst = f"{1e3 * each.worst_j:.2f} mJ" if each.worst_j > 0.0 else "nothing"
        yield f"| {each.kind} | **{each.gaining}** of {count} | {worst} | {each.servo_gaining} times |"
    yield ""
    yield from _words(
        "The last column does not count what the arm's own friction takes: encoders and the held force lend a little "
        "at speeds below 10 mm/s, where the controller's own noise would be worse than what it takes."
    )
    yield ""
    yield from _gaining(found[0])
    yield f"![Energies]({figures}/energies.svg)"


def _gaining(first: Energies) -> Iterator[str]:
    """List the hands that got energy out of the servo as the rig runs it."""
    got = sorted(zip(first.attacks, first.books, strict=True), key=lambda each: -each[1].gained_j)
    got = [each for each in got if each[1].gained_j > 0.0]
    if not got:
        return
    yield from _words(
        "The hands that gained from the servo as the rig runs it, the worst first. A force may change by 200 N/s, "
        "which is a promise of its own: a hand that leaves a wall faster than the force may fall is pushed on."
    )
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
