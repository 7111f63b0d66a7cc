"""Figures of what is felt."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from trocar.studies.accuracy.figures import open_figure, save_figure
from trocar.studies.feel.measure import DAMPINGS_N_S_M, WAYS, Border, Energies, Rendered


def draw_borders(passive: Sequence[Border], stable: Sequence[Border], stem: Path) -> list[Path]:
    """Draw borders of passivity and stability, theory as lines and what was measured as points."""
    figure, (first, second, third) = open_figure("A virtual wall: theory (lines) and the servo's law (points)", 3)
    for damping in DAMPINGS_N_S_M:
        rows = [row for row in passive if row.wall.damping_n_s_m == damping and not row.wall.delay]
        _border(first, [row.wall.stiffness_n_m for row in rows], rows, f"B = {damping} N s/m")
    _label(first, "passive above", "stiffness of the wall [N/m]", "friction of the device [N s/m]")
    for friction in (0.05, 0.1):
        rows = [row for row in stable if row.wall.friction_n_s_m == friction]
        _border(second, [row.wall.period_s * 1e3 for row in rows], rows, f"b = {friction} N s/m")
    _label(second, "stable below", "period of the servo [ms]", "stiffness of the wall [N/m]")
    rows = [row for row in stable if row.wall.friction_n_s_m == 0.5 and not row.wall.damping_n_s_m]
    rows.sort(key=lambda row: row.wall.delay)
    delays = [row.wall.delay for row in rows]
    _border(third, delays, rows, "force over the bus")
    third.plot(delays, [rows[0].measured] * len(rows), label="local model", color="tab:green")
    third.set_yscale("log")
    _label(third, "stable below, b = 0.5 N s/m", "delay [ms]", "stiffness of the wall [N/m]")
    return save_figure(figure, stem)


def draw_transparency(rendered: Sequence[Rendered], stem: Path) -> list[Path]:
    """Draw how much of a wall's stiffness a moving hand meets."""
    figure, (first, second) = open_figure("What a wall of 500 N/m is to a hand that moves", 2)
    for name, _ in WAYS:
        rows = [row for row in rendered if row.way == name]
        hertz = [row.frequency_hz for row in rows]
        first.plot(hertz, [row.stiffness.real for row in rows])
        second.plot(hertz, [row.late_deg for row in rows], label=name)
    for axes in (first, second):
        axes.set_xscale("log")
    _label(first, "elastic part", "frequency of the hand [Hz]", "stiffness in phase [N/m]")
    second.axhline(90.0, color="grey", linewidth=0.8)
    second.set_ylim(-20.0, 400.0)
    _label(second, "force behind position (a spring: 0)", "frequency of the hand [Hz]", "degrees")
    return save_figure(figure, stem)


def draw_energies(found: Sequence[Energies], stem: Path) -> list[Path]:
    """Draw what hands got out of each kind of servo, over what went to and fro."""
    figure, panels = open_figure(
        "Energy that hands got out (right of the line), of all that moved through the motors", 2
    )
    for axes, local in zip(panels, (True, False), strict=True):
        for each in found:
            if each.attacks[0].local != local:
                continue
            shares = [book.gained_j / max(book.moved_j, 1e-9) for book in each.books]
            axes.hist(np.clip(shares, -2.0, 1.0), bins=60, range=(-2.0, 1.0), histtype="step", label=each.kind)
        axes.axvline(0.0, color="grey", linewidth=0.8)
        axes.set_yscale("log")
        _label(axes, "local model" if local else "force over the bus", "gained over moved", "hands")
    return save_figure(figure, stem)


def _border(axes: Axes, places: Sequence[float], rows: Sequence[Border], label: str) -> None:
    (line,) = axes.plot(places, [row.theory for row in rows], label=label)
    axes.plot(places, [row.measured for row in rows], "o", color=line.get_color())


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.tick_params(labelsize=7)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=6)
