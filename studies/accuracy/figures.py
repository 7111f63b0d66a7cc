"""Error against cost as figures: one a study, one panel a quantity, the frontier in rings and drawn through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trocar.services.files.atomic_file import atomic_file
from trocar.studies.accuracy.figure_text import Name, place_names, plain_ticks
from trocar.studies.accuracy.frontier import ROUNDING, frontier
from trocar.studies.accuracy.study import Row

_COLUMNS, _WIDTH_IN, _HEIGHT_IN = 3, 4.4, 3.4
_WIDE = 4.0
"""Costs that are further apart than this take a logarithm."""


def draw_study(title: str, rows: Sequence[Row], stem: Path) -> list[Path]:
    """Draw a study as ``stem``.svg and .png and return both; without any cost the settings are bars."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    figure, panels = open_figure(title, len(quantities))
    draw_panels(figure, panels, rows)
    return save_figure(figure, stem)


def open_figure(title: str, n_panels: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with so many panels."""
    columns = min(_COLUMNS, n_panels)
    lines = math.ceil(n_panels / columns)
    figure = Figure((_WIDTH_IN * columns, _HEIGHT_IN * lines), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=10)
    return figure, [figure.add_subplot(lines, columns, place) for place in range(1, n_panels + 1)]


def save_figure(figure: Figure, stem: Path) -> list[Path]:
    """Write ``stem``.svg and .png: the same bytes for the same numbers, without a date or random names."""
    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    with mpl.rc_context({"svg.hashsalt": "trocar", "svg.fonttype": "none"}):
        with atomic_file(paths[0]) as half:
            figure.savefig(half, metadata={"Date": None})
        with atomic_file(paths[1]) as half:
            figure.savefig(half, dpi=110, metadata={"Software": None})
    return paths


def draw_panels(figure: Figure, panels: Sequence[Axes], rows: Sequence[Row]) -> None:
    """Draw one quantity a panel, each series in one colour throughout, and name the points where there is room."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    colours = {series: f"C{k % 10}" for k, series in enumerate(dict.fromkeys(row.series for row in rows))}
    names = []
    for axes, quantity in zip(panels, quantities, strict=True):
        names.append(_draw_panel(axes, [row for row in rows if row.quantity == quantity], colours))
    if any(names):
        figure.draw_without_rendering()  # only now is known where points lie
    for axes, of_panel in zip(panels, names, strict=True):
        place_names(axes, of_panel)


def _draw_panel(axes: Axes, rows: Sequence[Row], colours: dict[str, str]) -> list[Name]:
    """Draw error against cost, or bars where nothing was timed; return what to write beside the points."""
    axes.set_title(f"{rows[0].quantity} [{rows[0].unit}]", fontsize=9)
    axes.tick_params(labelsize=7)
    timed = [row for row in rows if row.cost is not None and math.isfinite(row.error)]
    if not timed:
        _draw_bars(axes, [row for row in rows if math.isfinite(row.error)])
        return []
    is_log = any(row.is_known for row in timed)
    _set_scales(axes, timed, is_log=is_log)
    best = frontier(timed)
    if best:
        x, y = zip(*(_place(row, is_log=is_log) for row in best), strict=True)
        axes.plot(x, y, color="0.3", linewidth=1.0, marker="o", markersize=8, markerfacecolor="none", zorder=0)
    for series in dict.fromkeys(row.series for row in timed):
        _draw_series(axes, [row for row in timed if row.series == series], colours[series], is_log=is_log)
    if len({row.series for row in timed}) > 1:
        axes.legend(fontsize=7)
    axes.set_xlabel("median cost of a millisecond [us]", fontsize=8)
    axes.grid(visible=True, which="both", linewidth=0.2)
    others = [row for row in timed if not any(row is each for each in best)]
    return [Name(_place(row, is_log=is_log), row.setting) for row in (*best, *others)]


def _set_scales(axes: Axes, rows: Sequence[Row], *, is_log: bool) -> None:
    medians = [row.cost.median_us for row in rows if row.cost]
    if max(medians) > _WIDE * min(medians):
        axes.set_xscale("log")
        plain_ticks(axes.xaxis, min(medians), max(medians))
    if is_log:
        axes.set_yscale("log")
        errors = [max(row.error, ROUNDING) for row in rows]
        plain_ticks(axes.yaxis, min(errors), max(errors), least=ROUNDING)
        if max(errors) <= ROUNDING:
            axes.set_ylim(0.1 * ROUNDING, 10.0 * ROUNDING)  # in one value a logarithm finds no limits


def _draw_series(axes: Axes, rows: Sequence[Row], colour: str, *, is_log: bool) -> None:
    x, y = zip(*(_place(row, is_log=is_log) for row in rows), strict=True)
    noise = [row.cost.noise_us for row in rows if row.cost is not None]
    axes.errorbar(x, y, xerr=noise, fmt="o", markersize=4, elinewidth=0.4, color=colour, label=rows[0].series or None)


def _place(row: Row, *, is_log: bool) -> tuple[float, float]:
    """Return where a row is drawn, in us and in its own unit."""
    if row.cost is None:
        raise ValueError(f"{row.setting} was not timed")
    return row.cost.median_us, max(row.error, ROUNDING) if is_log else row.error


def _draw_bars(axes: Axes, rows: Sequence[Row]) -> None:
    axes.barh([row.setting for row in rows], [max(row.error, ROUNDING) for row in rows], color="0.6")
    axes.set_xscale("log")
    axes.invert_yaxis()
