"""All pairs of effects: as a matrix, and which are more or less than both effects alone can come to."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from trocar.studies.accuracy.effect_pairs import COST, beyond_both, draw_matrices, effects_in, matrices, told_pairs
from trocar.studies.accuracy.report import number
from trocar.studies.accuracy.study import Cost, Row

NOISE_US = 2.0


def row(changed, quantity, value, us):
    cost = Cost(us, us, NOISE_US)
    return Row("effects", changed, "", quantity, value, "mm", is_known=False, cost=cost, choices={"changed": changed})


SETTINGS = (
    ("", 0.0, 0.0, 100.0),
    ("a", 3.0, 0.5, 110.0),
    ("b", 4.0, -0.2, 105.0),
    ("c", 1.0, 0.1, 101.0),
    ("a b", 5.0, 0.3, 140.0),  # 25 us more than both
    ("a c", 4.5, 0.1, 112.0),  # 0.5 more than the sum; depth 0.5 less than it
    ("b c", 2.0, -0.1, 106.0),  # 1 less than the difference; b and a c are not tried together
)
ROWS = [row(each[0], quantity, each[k], each[3]) for k, quantity in ((1, "force"), (2, "depth")) for each in SETTINGS]


@pytest.fixture
def found():
    return {matrix.title: matrix for matrix in matrices(ROWS, ("force", "depth"), signed=("depth",))}


def test_each_effect_alone_is_on_the_diagonal_and_pairs_are_on_both_sides(found):
    assert effects_in(ROWS) == ["a", "b", "c"]
    assert found["force"].values.tolist() == [[3.0, 5.0, 4.5], [5.0, 4.0, 2.0], [4.5, 2.0, 1.0]]
    assert found[COST].values.tolist() == [[10.0, 40.0, 12.0], [40.0, 5.0, 6.0], [12.0, 6.0, 1.0]]
    assert np.all(found[COST].noise == 2.0 * NOISE_US)


def test_two_root_mean_squares_lie_between_difference_and_sum(found):
    assert beyond_both(found["force"]) == pytest.approx(np.array([[0, 0, 0.5], [0, 0, -1.0], [0.5, -1.0, 0]]))


def test_what_has_a_sign_adds_up(found):
    assert beyond_both(found["depth"]) == pytest.approx(np.array([[0, 0, -0.5], [0, 0, 0], [-0.5, 0, 0]]))


def test_costs_add_up_but_for_noise(found):
    """Beyond both alone by 25 us where each of three is 4 us uncertain; 1 us and none are within that."""
    beyond = beyond_both(found[COST])
    assert beyond[0, 1] == pytest.approx(25.0)
    assert np.count_nonzero(beyond) == 2


def test_pairs_are_counted_and_the_furthest_named(found):
    told = told_pairs(found["force"], ["with a", "with b", "without c"], number)
    assert told.startswith("force: in 1 of 3 pairs the effects act independently")
    assert told.endswith("the largest deviation is with b and without c: 2 mm (1 less)")


def test_pairs_that_were_not_tried_are_neither_counted_nor_coloured(found):
    rows = [each for each in ROWS if each.setting != "a c"]
    without = {matrix.title: matrix for matrix in matrices(rows, ("force",), signed=())}["force"]
    assert "1 of 2 pairs" in told_pairs(without, list("abc"), number)
    figure = Figure().subfigures()
    draw_matrices(figure, [without, found[COST]], list("abc"))
    texts = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert texts[0] == ["3.0", "5.0", "4.0", "\N{EN DASH}", "2.0", "1.0"]
    assert texts[1] == ["10", "40", "5.0", "12", "6.0", "1.0"]
    assert [text.get_color() for text in figure.axes[1].texts][-1] == "0.55", "within the noise"
    assert not np.ma.getmaskarray(figure.axes[1].images[0].get_array())[1, 0]
    assert np.ma.getmaskarray(figure.axes[1].images[0].get_array())[2, 2]
    for axes in figure.axes:
        assert np.ma.getmaskarray(axes.images[0].get_array())[0, 1], "above the diagonal"
