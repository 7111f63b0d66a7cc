"""Points of the wall that the catheter pressed stay beside what is closest, where it has sunk in."""

import numpy as np
import pytest

from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs
from services.mechanics.contact.catheter_manifold import CatheterManifold
from services.mechanics.contact.pair_rows import append_pairs
from services.mechanics.simulation import Simulation

MARGIN_M, TRIANGLE, PARTICLE, DEEP_M = 0.5e-3, 60, 7, 20e-6


class WallAt:
    """A wall whose vertices are there."""

    def __init__(self, vertices_m):
        self._vertices_m = vertices_m

    def node_positions(self, nodes, out):
        out[:] = self._vertices_m[nodes]


class Rolling:
    """A particle of the catheter, pressed by 20 um into a triangle of the wall, which then turns about that point."""

    def __init__(self, simulation, mesh):
        self._system = simulation.system
        self._corners, self._vertices = mesh.triangles[TRIANGLE], mesh.vertices_m.copy()
        a, b, c = self._vertices[self._corners]
        across = np.cross(b - a, c - a)
        self._normal, self._turning = across / np.linalg.norm(across), (b - a) / np.linalg.norm(b - a)
        self._point = (a + b + c) / 3.0
        self.thickness_m = simulation.catheter.radius_m + self._system.geometry.wall.half_thickness
        rod = self._system.geometry.rod.position
        self._centre = self._point + (self.thickness_m - DEEP_M) * self._normal
        rod[:] = self._centre + np.outer(np.arange(len(rod)) - PARTICLE, self._turning) * 2e-3
        self._manifold = CatheterManifold(self._system.geometry.wall, MARGIN_M)

    def closest(self):
        """The pair that detection finds: the particle with the closest point of the triangle's plane."""
        corners = self._vertices[self._corners]
        a, b, c = corners
        across = np.cross(b - a, c - a)
        normal = across / np.linalg.norm(across)
        distance = normal @ (self._centre - a)
        foot = self._centre - distance * normal
        pairs = ContactPairs.allocate(8)
        pairs.tool[0], pairs.particle[0], pairs.target_kind[0], pairs.target[0] = (
            NO_TOOL,
            PARTICLE,
            DUCT_TRIANGLE,
            TRIANGLE,
        )
        pairs.target_weights[0] = np.linalg.solve(corners.T, foot)
        pairs.normal[0], pairs.gap_m[0], pairs.count = normal, distance - self.thickness_m, 1
        return pairs

    def press(self, *, slides=False, force_n=0.1, deepest_m=DEEP_M, owed_j=0.0):
        """Solve a step with the closest point as the only row."""
        self._system.clear()
        append_pairs(self.closest(), self._system.geometry, self._system.rows)
        self._system.rows.force_n[0, 0] = force_n
        self._system.slides[0] = slides
        self._system._state.ledger.owed_j = owed_j
        self._manifold.keep(self._system, deepest_m)

    def turn(self, angle):
        """Turn the wall about the pressed point and an axis in it."""
        arm = self._vertices - self._point
        self._vertices = self._point + (
            np.cos(angle) * arm
            + np.sin(angle) * np.cross(self._turning, arm)
            + (1.0 - np.cos(angle)) * np.outer(arm @ self._turning, self._turning)
        )

    def move_through(self):
        """Put the particle as far behind the point as it was before it."""
        self._centre = self._point - (self.thickness_m - DEEP_M) * self._normal
        self._system.geometry.rod.position[PARTICLE] = self._centre

    def pairs(self, further_m=0.0):
        """What is found, so much further off than it is, and what was kept."""
        pairs = self.closest()
        pairs.gap_m[0] += further_m
        self._manifold.append_to(pairs, WallAt(self._vertices), self._system.geometry)
        return pairs


@pytest.fixture
def rolling(small_scene, small_duct):
    return Rolling(Simulation(small_scene, small_duct), small_duct.mesh)


def test_a_wall_that_turns_about_the_catheter_keeps_the_point_about_which_it_turns(rolling):
    """What is closest is r theta aside then, and r theta^2 / 2 deeper: by that much it sank in, one way and back."""
    angle, r_m = 0.13, rolling.thickness_m - DEEP_M
    rolling.press()
    rolling.turn(angle)
    pairs = rolling.pairs()
    assert pairs.count == 2
    assert pairs.gap_m[1] == pytest.approx(-DEEP_M, abs=1e-12)
    assert pairs.gap_m[0] - pairs.gap_m[1] == pytest.approx(-r_m * (1.0 - np.cos(angle)), rel=1e-9)
    assert pairs.particle[1] == PARTICLE
    assert pairs.normal[1] @ pairs.normal[0] == pytest.approx(np.cos(angle), rel=1e-9)


def test_what_is_found_again_has_one_pair(rolling):
    rolling.press()
    assert rolling.pairs().count == 1


def test_a_point_that_stuck_is_found_where_it_was(rolling):
    """What is closest 10 um beside it was deeper by 0.05 um in each tick: a light wall was swung by that for ever."""
    rolling.press()
    rolling.turn(0.01)
    closest, pairs = rolling.closest(), rolling.pairs()
    assert pairs.count == 1
    assert pairs.gap_m[0] == pytest.approx(-DEEP_M, abs=1e-12)
    assert closest.gap_m[0] < -DEEP_M - 40e-9
    rolling.press(slides=True)
    rolling.turn(0.01)
    assert rolling.pairs().gap_m[0] == rolling.closest().gap_m[0]


def test_a_point_that_slid_is_one_with_what_is_found_next_to_it(rolling):
    rolling.press(slides=True)
    rolling.turn(0.1)
    assert rolling.pairs().count == 1
    rolling.turn(0.1)
    assert rolling.pairs().count == 2


def test_what_is_found_beside_a_point_that_slid_stands_for_it_where_it_is_as_deep_only(rolling):
    """One of two lips that jaws squeeze was 0.19 mm in the catheter by turns: what lay beside it was not even near."""
    angle = 0.1
    nearer_m = (rolling.thickness_m - DEEP_M) * (1.0 - np.cos(angle))
    rolling.press(slides=True)
    rolling.turn(angle)
    assert rolling.pairs(nearer_m + 4.9e-6).count == 1
    assert rolling.pairs(nearer_m + 5.1e-6).count == 2


def test_nothing_is_kept_that_bears_nothing_or_where_nothing_is_deep_or_owed(rolling):
    rolling.press()
    rolling.press(force_n=0.0)
    rolling.turn(0.13)
    assert rolling.pairs().count == 1
    rolling.press()
    rolling.press(deepest_m=1e-6)
    rolling.turn(0.13)
    assert rolling.pairs().count == 1
    rolling.press(deepest_m=1e-6, owed_j=1e-9)
    rolling.turn(0.13)
    assert rolling.pairs().count == 2


def test_a_point_that_the_catheter_has_gone_round_is_let_go(rolling):
    rolling.press()
    rolling.turn(0.13)
    assert rolling.pairs().count == 2
    rolling.move_through()
    assert rolling.pairs().count == 1
