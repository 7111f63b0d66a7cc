"""Operations and time over the size of a mesh, beside lines that grow as n, n log n and n^2."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from trocar.studies.accuracy.figure_text import plain_ticks
from trocar.studies.accuracy.figures import draw_panels, open_figure, save_figure
from trocar.studies.accuracy.study import Row

_ROOM_FOR_LEGEND = 0.35
"""Of the panel's height, above what is drawn."""


def draw_growth(title: str, growing: Sequence[Row], others: Sequence[Row], stem: Path) -> list[Path]:
    """Draw two panels of growth, then one a quantity of the other rows."""
    quantities = list(dict.fromkeys(row.quantity for row in others))
    figure, panels = open_figure(title, 2 + len(quantities))
    _grow(panels[0], growing, {id(row): row.error for row in growing}, "operations a step")
    times = {id(row): row.cost.median_us for row in growing if row.cost is not None}
    _grow(panels[1], growing, times, "time of a step [us]")
    draw_panels(figure, panels[2:], others)
    return save_figure(figure, stem)


def growth_exponents(growing: Sequence[Row], values: dict[int, float]) -> dict[str, float]:
    """Return by series the slope of log value over log n between the two largest meshes."""
    found = {}
    for series in dict.fromkeys(row.series for row in growing):
        mine = [row for row in growing if row.series == series and id(row) in values]
        if len(mine) > 1:
            one, two = mine[-2:]
            found[series] = float(
                np.log(values[id(two)] / values[id(one)]) / np.log(float(two.choices["n"]) / float(one.choices["n"]))
            )
    return found


def _grow(axes: Axes, rows: Sequence[Row], values: dict[int, float], title: str) -> None:
    exponents = growth_exponents(rows, values)
    for series in dict.fromkeys(row.series for row in rows):
        mine = [row for row in rows if row.series == series and id(row) in values]
        label = f"{series} (n^{exponents[series]:.2f} at the end)" if series in exponents else series
        axes.plot([float(row.choices["n"]) for row in mine], [values[id(row)] for row in mine], "o-", ms=3, label=label)
    sizes = np.array(sorted({float(row.choices["n"]) for row in rows}))
    start = min(values.values(), default=1.0)
    for name, line in (("n", sizes), ("n log n", sizes * np.log(sizes)), ("n^2", sizes**2)):
        axes.plot(sizes, start * line / line[0], "--", color="0.6", linewidth=0.7)
        axes.annotate(name, (sizes[-1], start * line[-1] / line[0]), fontsize=6)
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain_ticks(axes.xaxis, sizes.min(), sizes.max())
    axes.tick_params(labelsize=7)
    axes.set_xlabel("n, degrees of freedom", fontsize=8)
    axes.set_title(title, fontsize=9)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** _ROOM_FOR_LEGEND)
    axes.legend(fontsize=6, loc="upper left")
