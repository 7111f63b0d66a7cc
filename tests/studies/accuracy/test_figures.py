"""What is written in the figures: it can be read."""

import itertools

import pytest
from matplotlib.transforms import Bbox

from trocar.studies.accuracy.figures import draw_panels, open_figure
from trocar.studies.accuracy.frontier import frontier
from trocar.studies.accuracy.study import Cost, Row


def row(setting, error, us, series="one", quantity="force", *, is_known=True):
    return Row("modes", setting, series, quantity, error, "%", is_known, Cost(us, 2.0 * us, 3.0))


CROWD = [row(f"{n} modes, residual", 1e-7 / n, 155.0 + n / 10.0) for n in (10, 20, 40, 60, 80, 120)]
"""Six points on the floor of the panel, some of which lie on one another."""
RIGHTMOST = [row("cheap", 30.0, 100.0), row("a name that would leave the panel at the right", 1.0, 250.0)]
TWO = [row(f"{n} modes, {s}", e / n, 155.0 + n / 10.0, s) for s, e in (("bare", 9.0), ("full", 1.0)) for n in (10, 40)]
WIDE = [row("small", 0.0021, 110.0, "ours"), row("large", 131.0, 790.0, "theirs")]
CHANGES = [row(f"effect {n}", 0.1 * n, 170.0 + n, "one effect", is_known=False) for n in range(20)]


PANELS = {}
"""By the rows in words: the panels that are drawn already. Tests look at them and change nothing."""


def drawn(rows):
    if repr(rows) not in PANELS:
        figure, PANELS[repr(rows)] = open_figure("a title", len({each.quantity for each in rows}))
        draw_panels(figure, PANELS[repr(rows)], rows)
        figure.draw_without_rendering()
    return PANELS[repr(rows)]


@pytest.mark.parametrize("rows", [CROWD, RIGHTMOST, TWO, WIDE, CHANGES], ids=lambda rows: rows[0].setting)
def test_names_cover_neither_one_another_nor_points_nor_the_legend_and_stay_in_the_panel(rows):
    (axes,) = drawn(rows)
    boxes = [text.get_window_extent() for text in axes.texts]
    assert boxes
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    if axes.get_legend():
        assert not any(box.overlaps(axes.get_legend().get_window_extent()) for box in boxes)
    for line in axes.get_lines():
        half = 0.5 * line.get_markersize() * axes.get_figure().dpi / 72.0
        for x, y in axes.transData.transform(line.get_xydata()) if line.get_marker() == "o" else ():
            assert not any(box.overlaps(Bbox.from_bounds(x - half, y - half, 2 * half, 2 * half)) for box in boxes)
    panel = axes.get_window_extent()
    assert all(panel.x0 <= box.x0 and box.x1 <= panel.x1 for box in boxes)


@pytest.mark.parametrize("rows", [CROWD, RIGHTMOST, WIDE], ids=["crowd", "rightmost", "wide"])
def test_who_is_on_the_frontier_is_named_first(rows):
    (axes,) = drawn(rows)
    assert frontier(rows)[0].setting in {text.get_text() for text in axes.texts}


def test_a_legend_stands_where_there_is_something_to_tell_apart():
    assert [bool(drawn(rows)[0].get_legend()) for rows in (CROWD, TWO, WIDE, CHANGES)] == [False, True, True, False]


def test_who_is_on_the_frontier_has_a_ring_even_where_there_is_no_line():
    alone = [row("beaten within noise", 2.0, 100.0), row("best", 1.0, 103.0)]
    for rows, names in ((alone, ["best"]), (RIGHTMOST, [each.setting for each in RIGHTMOST])):
        (axes,) = drawn(rows)
        (rings,) = [line for line in axes.get_lines() if line.get_markerfacecolor() == "none"]
        assert [x for x, _ in rings.get_xydata()] == [each.cost.median_us for each in rows if each.setting in names]


def test_every_axis_has_plain_numbers_that_do_not_cover_one_another():
    for axes in (*drawn(WIDE), *drawn(CROWD), *drawn(RIGHTMOST)):
        for axis, side in ((axes.xaxis, "x"), (axes.yaxis, "y")):
            labels = [label for label in axis.get_ticklabels(which="both") if label.get_text()]
            texts = {label.get_text().removeprefix("\N{LESS-THAN OR EQUAL TO} ") for label in labels}
            assert len({float(text) for text in texts}) >= 1, side
            inside = [label.get_window_extent() for label in labels if _is_seen(label, axes, side)]
            assert not any(one.overlaps(other) for one, other in itertools.combinations(inside, 2))
            assert len({label.get_fontsize() for label in labels}) == 1


def _is_seen(label, axes, side):
    low, high = sorted(axes.get_xlim() if side == "x" else axes.get_ylim())
    return low <= label.get_position()[side == "y"] <= high


def test_a_series_has_one_colour_in_all_panels():
    rows = [
        row("a", 1.0, 100.0, "bare"),
        row("b", 2.0, 110.0, "residual"),
        row("b", 3.0, 110.0, "residual", "motion"),
    ]
    first, second = drawn(rows)
    colours = [dict(zip(("bare", "residual"), panel.containers, strict=False)) for panel in (first, second)]
    assert colours[0]["residual"][0].get_color() == second.containers[0][0].get_color()
