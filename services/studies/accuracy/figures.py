"""Error against cost as figures: one a study, one panel a quantity, the frontier drawn through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from services.studies.accuracy.frontier import frontier
from services.studies.accuracy.study import Row
from services.whole_file import whole_file

_COLUMNS, _WIDTH_IN, _HEIGHT_IN = 3, 4.4, 3.4
_LEAST = 1e-4
"""Errors below are rounding: they are drawn here, so that a logarithm can show them."""
_MOST_LABELS = 14
_WIDE = 4.0
"""Costs that are further apart than this take a logarithm."""


def draw_study(title: str, rows: Sequence[Row], stem: Path) -> list[Path]:
    """Draw a study as ``stem``.svg and .png and return both; without any cost the settings are bars."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    figure, panels = open_figure(title, len(quantities))
    for axes, quantity in zip(panels, quantities, strict=True):
        draw_panel(axes, [row for row in rows if row.quantity == quantity])
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
        with whole_file(paths[0]) as half:
            figure.savefig(half, metadata={"Date": None})
        with whole_file(paths[1]) as half:
            figure.savefig(half, dpi=110, metadata={"Software": None})
    return paths


def draw_panel(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw one quantity: error against cost, or bars where nothing was timed."""
    axes.set_title(f"{rows[0].quantity} [{rows[0].unit}]", fontsize=9)
    axes.tick_params(labelsize=7)
    timed = [row for row in rows if row.cost is not None and math.isfinite(row.error)]
    if timed:
        _draw_points(axes, timed)
        axes.set_xlabel("median cost of a millisecond [us]", fontsize=8)
    else:
        _draw_bars(axes, [row for row in rows if math.isfinite(row.error)])


def _draw_points(axes: Axes, rows: Sequence[Row]) -> None:
    is_known = rows[0].is_known
    medians = [row.cost.median_us for row in rows if row.cost]
    if max(medians) > _WIDE * min(medians):
        axes.set_xscale("log")
    if is_known:
        axes.set_yscale("log")
        if max(row.error for row in rows) <= _LEAST:
            axes.set_ylim(0.1 * _LEAST, 10.0 * _LEAST)  # in one value a logarithm finds no limits
    for series, members in groupby(sorted(rows, key=lambda row: row.series), key=lambda row: row.series):
        mine = list(members)
        x, y, noise = [], [], []
        for row in mine:
            if row.cost is not None:
                x.append(row.cost.median_us)
                y.append(max(row.error, _LEAST) if is_known else row.error)
                noise.append(row.cost.noise_us)
        axes.errorbar(x, y, xerr=noise, fmt="o", markersize=4, elinewidth=0.4, label=series or None)
    best = frontier(rows)
    if best:
        line = [(row.cost.median_us, max(row.error, _LEAST)) for row in best if row.cost]
        axes.plot(*zip(*line, strict=True), color="0.3", linewidth=1.0, zorder=0)
    for row in rows if len(rows) <= _MOST_LABELS else best:
        if row.cost is not None:
            place = (row.cost.median_us, max(row.error, _LEAST) if is_known else row.error)
            axes.annotate(row.setting, place, fontsize=5.5, xytext=(3, 3), textcoords="offset points")
    if any(row.series for row in rows):
        axes.legend(fontsize=7)
    axes.grid(visible=True, which="both", linewidth=0.2)


def _draw_bars(axes: Axes, rows: Sequence[Row]) -> None:
    axes.barh([row.setting for row in rows], [max(row.error, _LEAST) for row in rows], color="0.6")
    axes.set_xscale("log")
    axes.invert_yaxis()
