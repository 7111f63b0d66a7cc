"""The rule for cells: what jaws feel is converged, on ducts of several sizes; no duct gets more than memory holds."""

from dataclasses import replace

import pytest

from tests.by_day import by_day
from trocar.services.mechanics.scene import DuctScene
from trocar.services.mechanics.scene.mesh_cells import MOST_NODES, MOST_NODES_ALL_PAIRS, accurate_cells
from trocar.studies.accuracy.pinches import Pinch, full_model

JAW_RADIUS_M = 1e-3
DUCTS = {
    "default": DuctScene(thickness_m=1e-3),
    "thin": DuctScene(thickness_m=0.5e-3),
    "narrow": DuctScene(radius_m=3e-3, length_m=24e-3, thickness_m=0.8e-3),
    "wide": DuctScene(radius_m=6e-3, length_m=30e-3, thickness_m=1.2e-3),
}


def closing_m(duct: DuctScene, cells) -> float:
    """How much closer opposite unit forces, spread over a jaw's width, bring the wall; no reduction."""
    model = full_model(replace(duct, n_around=cells[0], n_along=cells[1]))
    pinch = Pinch.of(model.mesh, duct)
    return pinch.closing_m(model.solve_static(pinch.load_n(model.mesh.n_vertices)).displacement_m)


@pytest.mark.parametrize("name", by_day(["narrow", "wide"], ["default", "thin"]))
def test_a_pinch_is_converged_with_these_cells_and_far_from_it_with_a_third(name):
    duct = DUCTS[name]
    cells = accurate_cells(duct.radius_m, duct.length_m, JAW_RADIUS_M)
    third, chosen, finer = (closing_m(duct, [round(f * n) for n in cells]) for f in (1 / 3, 1.0, 1.5))
    # The error falls with the square of the cell: 1 - 1 / 1.5^2 of it lies between these two.
    limit = chosen + (finer - chosen) / (1.0 - 1.5**-2)
    error, coarse_error = limit / chosen - 1.0, limit / third - 1.0
    print(f"{cells[0]} x {cells[1]} cells: {error:.2%} off, {coarse_error:.1%} with a third of them")
    assert 0.0 < error < 0.01
    assert coarse_error == pytest.approx(9.0 * error, rel=0.3), "the limit was found from errors of second order"


@pytest.mark.parametrize("radius_m", [1e-5, 4e-3, 1.0])
@pytest.mark.parametrize("length_m", [1e-5, 40e-3, 5.0])
@pytest.mark.parametrize("jaw_radius_m", [1e-5, 1e-3, 1.0])
def test_any_duct_has_cells_and_no_more_nodes_than_are_held(radius_m, length_m, jaw_radius_m):
    around, along = accurate_cells(radius_m, length_m, jaw_radius_m)
    assert around >= 8
    assert around % 2 == 0, "diagonals alternate round the seam"
    assert along >= 2
    assert around * (along + 1) <= MOST_NODES
    around, along = accurate_cells(radius_m, length_m, jaw_radius_m, MOST_NODES_ALL_PAIRS)
    assert around * (along + 1) <= MOST_NODES_ALL_PAIRS
