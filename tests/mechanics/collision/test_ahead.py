"""Who slides along the wall has met, in time, what it slides to: the planes of the pairs keep it out of every facet."""

import numpy as np
import pytest
from collision_cases import (
    CATHETER_M,
    HALF_M,
    MARGIN_M,
    RADIUS_M,
    carried_surface,
    deformed,
    distances_to_triangles,
    duct_mesh,
    rigid_surface,
    rows,
)

from services.mechanics.collision import CatheterContactDetector
from services.mechanics.collision.pairs import ContactPairs

THICKNESS_M = CATHETER_M + HALF_M
# Of an overlap a fifth is taken back in a millisecond: from tick to tick this grows to a tenth of a millimetre.
DEEPEST_M = 20e-6


def pairs_of(detector, positions, ahead=None):
    pairs = ContactPairs.allocate(64)
    detector.detect(np.asarray(positions, float), pairs, ahead)
    return rows(pairs)


def stopped(found, motion):
    """Where a motion goes that the planes of the pairs stop one after the other."""
    way = np.array(motion)
    for _ in range(200):
        for row in found:
            way -= min(row["gap_m"] + row["normal"] @ way, 0.0) * row["normal"]
    return way


def slides(seed):
    """A particle that touches the wall inside, and a slide of up to 1.2 mm along it."""
    rng = np.random.default_rng(seed)
    around, height = rng.uniform(0.0, 2.0 * np.pi), RADIUS_M * np.cos(np.pi / 48) - THICKNESS_M
    out, along = np.array([0.0, np.cos(around), np.sin(around)]), rng.uniform(-1.0, 1.0)
    sideways = np.cross([1.0, 0.0, 0.0], out) * np.sign(rng.normal()) * np.sqrt(1.0 - along**2)
    slide = rng.uniform(0.3e-3, 1.2e-3) * (sideways + along * np.array([1.0, 0.0, 0.0]))
    return np.array([20.2e-3, 0.0, 0.0]) + (height - 2e-6) * out, slide


def depth_m(surface, place):
    return THICKNESS_M - distances_to_triangles(place, deformed(surface), surface.mesh.triangles).min()


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("how", ["as it went", "let go", "by the wall"])
def test_a_particle_that_slides_along_the_wall_comes_into_no_facet(how, seed):
    surface = carried_surface(duct_mesh(48, 60))
    detector = CatheterContactDetector(surface, 1, CATHETER_M, MARGIN_M)
    place, slide = slides(seed)
    surface.update(slide if how == "by the wall" else np.zeros(3))
    pairs_of(detector, [place - slide if how == "as it went" else place])
    surface.update(np.zeros(3))
    found = pairs_of(detector, [place], slide[None] if how == "let go" else None)
    assert depth_m(surface, place + stopped(found, slide)) < DEEPEST_M


@pytest.mark.parametrize("is_let_go", [False, True])
@pytest.mark.parametrize("slide_m", [0.3e-3, -0.6e-3, 1.0e-3])
def test_a_segment_that_slides_along_the_edge_of_an_opening_comes_into_no_part_of_it(slide_m, is_let_go):
    surface = rigid_surface(duct_mesh(48, 60))
    detector = CatheterContactDetector(surface, 2, CATHETER_M, MARGIN_M)
    y, slide = RADIUS_M * np.cos(np.pi / 48) - THICKNESS_M - 2e-6, np.array([0.0, 0.0, slide_m])
    ends = np.array([[37e-3, y, 0.1e-3], [43e-3, y, 0.1e-3]])
    surface.update(np.zeros(0))
    pairs_of(detector, ends if is_let_go else ends - slide)
    surface.update(np.zeros(0))
    found = pairs_of(detector, ends, np.tile(slide, (2, 1)) if is_let_go else None)
    way = stopped([row for row in found if row["tool_parameter"] > 0.0], slide)
    lip = np.array([40e-3, *(ends[0] + way)[1:]])
    assert depth_m(surface, lip) < DEEPEST_M


def test_who_hardly_moves_meets_nothing_ahead():
    """A slow one has the pairs of one at rest: what lies beside is met when it is there."""
    surface = rigid_surface(duct_mesh(48, 60))
    detector = CatheterContactDetector(surface, 1, CATHETER_M, MARGIN_M)
    place, slide = slides(0)
    at_rest = len(pairs_of(detector, [place]))
    surface.update(np.zeros(0))
    assert len(pairs_of(detector, [place], 0.04e-3 * slide[None] / np.linalg.norm(slide))) == at_rest
