"""What is written in a figure: ticks as plain numbers, and names beside points that cover nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from matplotlib.transforms import Bbox

_SIZE = 5.5
_POINT_PX = 6.5
"""Half of what a point and its ring take up of a figure of 100 dots an inch."""
_MANY_DECADES = 3.0


@dataclass(frozen=True, slots=True)
class Name:
    """What is to stand beside a point, in the coordinates of its panel's data."""

    place: tuple[float, float]
    text: str


def plain_ticks(axis: Axis, lowest: float, highest: float, least: float | None = None) -> None:
    """Mark a logarithmic axis with numbers that are read at once: 1, 2, 5 or, over many decades, powers of ten.

    At and below ``least``, where what is smaller is drawn as well, a tick says so.
    """
    decades = math.log10(highest / lowest)
    steps = (1.0,) if decades > _MANY_DECADES else (1.0, 2.0, 5.0) if decades > 1.0 else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
    axis.set_major_locator(LogLocator(subs=steps, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _told(value, least)))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _told(value: float, least: float | None) -> str:
    if least is not None and value <= 1.01 * least:
        return f"\u2264 {least:g}" if value >= 0.99 * least else ""
    return f"{value:g}"


def place_names(axes: Axes, names: Sequence[Name]) -> None:
    """Write names beside their points, the first first; one that would cover another, or a point, is left out.

    The figure has to be laid out already. Names neither leave the panel nor change the layout.
    """
    points = [axes.transData.transform(name.place) for name in names]
    taken = [Bbox.from_bounds(x - _POINT_PX, y - _POINT_PX, 2 * _POINT_PX, 2 * _POINT_PX) for x, y in points]
    legend = axes.get_legend()
    if legend is not None:
        taken.append(legend.get_window_extent())
    for name in names:
        for written in _tries(axes, name):
            box = written.get_window_extent()
            if _is_within(box, axes.bbox) and not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            written.remove()


def _tries(axes: Axes, name: Name) -> Iterator[Annotation]:
    """Write a name above and below its point, right and left of it, one after the other."""
    for across, side in ((6, "left"), (-6, "right")):
        for up, edge in ((5, "bottom"), (-5, "top")):
            written = axes.annotate(
                name.text,
                name.place,
                fontsize=_SIZE,
                xytext=(across, up),
                textcoords="offset points",
                horizontalalignment=side,
                verticalalignment=edge,
            )
            written.set_in_layout(False)
            yield written


def _is_within(box: Bbox, panel: Bbox) -> bool:
    return bool(box.x0 >= panel.x0 and box.x1 <= panel.x1 and box.y0 >= panel.y0 and box.y1 <= panel.y1)
