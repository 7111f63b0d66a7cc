"""Points of the wall that a tool pressed on stay candidates, each for itself."""

import numpy as np
import pytest

from services.mechanics.collision.pairs import DUCT_TRIANGLE, SHAFT, ContactPairs
from services.mechanics.contact.manifold import ContactManifold
from services.mechanics.contact.pair_rows import append_pairs
from services.mechanics.simulation import Simulation

MARGIN_M = 0.5e-3
APART_M = 0.17e-3


class AtRest:
    """The wall where it is at rest."""

    def __init__(self, vertices_m):
        self._vertices_m = vertices_m

    def node_positions(self, nodes, out):
        out[:] = self._vertices_m[nodes]


@pytest.fixture
def pressed(small_scene, small_duct):
    """The sphere at the end of a shaft on two points of one triangle, and a function that keeps them and lists them."""
    simulation = Simulation(small_scene, small_duct)
    system, tools = simulation.system, simulation.tools
    vertices, corners = small_duct.mesh.vertices_m, small_duct.mesh.triangles[60]
    a, b, c = vertices[corners]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    s = APART_M / np.linalg.norm(b - a)
    weights = np.array([[0.5, 0.2, 0.3], [0.5 - s, 0.2 + s, 0.3]])
    radius_m = tools.radius_m[0, SHAFT] + system.geometry.wall.half_thickness
    tools.present[:] = True
    points = weights @ (a, b, c)
    tools.segments[0, SHAFT] = centre = points[0] + radius_m * normal
    manifold = ContactManifold(system.geometry.wall, MARGIN_M)

    def keep(slid, found):
        """Press points, of which some slid, find some of them again, and return how many pairs there are."""
        pairs = pairs_at_points(list(slid))
        system.clear()
        append_pairs(pairs, system.geometry, system.rows)
        system.rows.force_n[: pairs.count, 0] = 0.1
        manifold.keep(system.rows, np.array(list(slid.values())))
        pairs = pairs_at_points(found)
        manifold.append_to(pairs, AtRest(vertices), system.geometry)
        return pairs.count

    def pairs_at_points(which):
        pairs = ContactPairs.allocate(8)
        for i, k in enumerate(which):
            pairs.tool[i], pairs.tool_segment[i], pairs.particle[i] = 0, SHAFT, -1
            pairs.target_kind[i], pairs.target[i], pairs.target_weights[i] = DUCT_TRIANGLE, 60, weights[k]
            away = centre - points[k]
            pairs.normal[i] = away / np.linalg.norm(away)
            pairs.gap_m[i] = np.linalg.norm(away) - radius_m
        pairs.count = len(which)
        return pairs

    return keep


def test_a_point_that_slid_is_one_with_what_is_found_next_to_it(pressed):
    assert pressed({1: True}, [0]) == 1
    assert pressed({1: False}, [0]) == 2
    assert pressed({0: False, 1: False}, [0, 1]) == 2


@pytest.mark.parametrize("first_slides", [False, True])
def test_a_point_that_slid_is_not_one_with_another_kept_point_that_is_found_again(pressed, first_slides):
    """Before, it was let go: a sphere on two points of a triangle sank in as these took turns, by 0.156 mm."""
    assert pressed({0: first_slides, 1: True}, [0]) == 2
    assert pressed({0: True, 1: first_slides}, [1]) == 2
