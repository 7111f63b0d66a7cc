"""What closing jaws touch, against their distances from every triangle and every segment."""

from __future__ import annotations

import numpy as np
import pytest

from tests.mechanics.collision.wall_cases import KINDS, coordinates, placed, wall
from trocar.protocol.arrays import pack
from trocar.protocol.bodies import Catheter, Duct
from trocar.services.haptics.deformed_scene import DeformedScene
from trocar.services.haptics.jaw_touches import JawTouches
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.grasp import GRASP_GAP_M, deepest_touches
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, JAW_A, JAW_B
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import CatheterScene, DuctScene, SceneModel
from trocar.studies.judge.closest import nearest_segments, nearest_triangles

SCENE = SceneModel(duct=DuctScene(thickness_m=0.5e-3), catheter=CatheterScene(n_segments=30, length_m=60e-3))
CATHETER_M, HALF_M = 0.5 * SCENE.catheter.outer_diameter_m, 0.5 * SCENE.duct.thickness_m
RADIUS_M = np.array([[2.5e-3, 1.0e-3, 1.0e-3], [2.5e-3, 0.8e-3, 0.8e-3]])
JAWS = [(tool, jaw) for tool in range(2) for jaw in (JAW_A, JAW_B)]
CLOSE_M = 5e-9  # the residual is kept in single precision
TICKS = 120


class World:
    """A wall, a catheter and jaws that move by little or much from tick to tick, and what looks at them."""

    def __init__(self, duct: ReducedDuct, seed: int) -> None:
        self.duct, self.rng = duct, np.random.default_rng(seed)
        self.scene, self.touches = DeformedScene(SCENE, duct), JawTouches(SCENE, duct, RADIUS_M)
        self.segments_m = np.zeros((2, 3, 2, 3))
        self.q = coordinates(duct, self.rng, 2e-3)
        self.line_m = np.zeros((31, 3))
        self.move()

    def move(self) -> None:
        """Deform the wall; bend the catheter anew, and put each jaw where it just touches one or the other, or not."""
        rng, n = self.rng, self.duct.mesh.n_vertices
        self.q += coordinates(self.duct, rng, 1e-6 if rng.random() < 0.7 else 0.5e-3)
        count = int(rng.integers(0, 6))
        loads = rng.choice(n, count, replace=False).astype(np.int32), rng.normal(size=(count, 3)) * 0.05
        self.vertices_m = placed(self.duct, self.q, loads)
        if rng.random() < 0.2:
            way = rng.normal(size=(30, 3)) * 0.3 + (1.0, 0.0, 0.0)
            ends = np.cumsum(2e-3 * way / np.linalg.norm(way, axis=1)[:, None], axis=0)
            self.line_m = np.vstack([np.zeros(3), ends]) + rng.normal(size=3) * 3e-3
        for tool, jaw in JAWS:
            if rng.random() < 0.5:
                self.segments_m[tool, jaw] += rng.normal(size=3) * 20e-6
            else:
                self.segments_m[tool, jaw] = self._beside(*self._place(tool, jaw))
        self._tell(loads)

    def _place(self, tool: int, jaw: int) -> tuple[FloatArray, float]:
        """Return a point of wall or catheter, and how far off a jaw's axis about touches it."""
        rng = self.rng
        if rng.random() < 0.5:
            return self.line_m[rng.integers(0, 31)], CATHETER_M + RADIUS_M[tool, jaw]
        corners = self.vertices_m[self.duct.mesh.triangles[rng.integers(0, len(self.duct.mesh.triangles))]]
        at: FloatArray = rng.dirichlet(np.ones(3)) @ corners
        return at, HALF_M + RADIUS_M[tool, jaw]

    def _beside(self, at: FloatArray, apart_m: float) -> FloatArray:
        """Return the ends of a jaw about so far from a point."""
        rng = self.rng
        away, along = rng.normal(size=(2, 3))
        away /= np.linalg.norm(away)
        along -= (along @ away) * away
        along *= rng.uniform(0.0, 8e-3) / np.linalg.norm(along)
        start = at + away * (apart_m + rng.uniform(-0.2e-3, 0.3e-3))
        return np.array([start - rng.uniform(0.0, 1.0) * along, start + rng.uniform(0.0, 1.0) * along])

    def _tell(self, loads: tuple[np.ndarray, FloatArray]) -> None:
        basis = self.duct.basis
        self.scene.take_duct(
            Duct(
                basis_hash=basis.content_hash, q=pack(self.q), q_rate=pack(self.q),
                load_node=pack(loads[0], "<i4"), load_force_n=pack(loads[1]),
            )
        )  # fmt: skip
        at = pack(self.line_m)
        self.scene.take_catheter(Catheter(position_m=at, velocity_m_s=at, radius_m=CATHETER_M))
        assert not self.scene.refused

    def gaps_m(self) -> dict[tuple[int, int, int], float]:
        """Return the gap of each jaw from wall and catheter, each against each."""
        ends_m = np.array([self.segments_m[each] for each in JAWS])
        radius_m = np.array([RADIUS_M[each] for each in JAWS])
        of_wall, of_line = np.zeros((len(JAWS), 3)), np.zeros(len(JAWS))
        nearest_triangles(ends_m, np.ones(len(JAWS)), self.vertices_m, self.duct.mesh.triangles, of_wall)
        nearest_segments(ends_m, self.line_m, of_line)
        gaps: dict[tuple[int, int, int], float] = {}
        for k, each in enumerate(JAWS):
            gaps[(*each, DUCT_TRIANGLE)] = of_wall[k, 0] - radius_m[k] - HALF_M
            gaps[(*each, CATHETER_SEGMENT)] = of_line[k] - radius_m[k] - CATHETER_M
        return gaps

    def point_m(self, i: int) -> FloatArray:
        """Return the point of wall or catheter that a pair says is touched."""
        pairs = self.touches.pairs
        weights, target = pairs.target_weights[i], int(pairs.target[i])
        if pairs.target_kind[i] == DUCT_TRIANGLE:
            return np.asarray(weights @ self.vertices_m[self.duct.mesh.triangles[target]])
        return np.asarray(weights[:2] @ self.line_m[target : target + 2])

    def axis_m(self, i: int) -> FloatArray:
        """Return the point of a jaw's axis at which a pair says that it touches."""
        pairs = self.touches.pairs
        ends = self.segments_m[pairs.tool[i], pairs.tool_segment[i]]
        return np.asarray(ends[0] + pairs.tool_parameter[i] * (ends[1] - ends[0]))


@pytest.mark.parametrize("kind", KINDS)
def test_jaws_touch_exactly_what_is_within_the_gap_of_a_grasp(kind: str) -> None:
    world, seen = World(wall(kind), 5), {True: 0, False: 0}
    for _ in range(TICKS):
        world.move()
        looks = [tool for tool in range(2) if world.rng.random() < 0.7]
        world.touches.find(looks, world.segments_m, world.scene)
        pairs = world.touches.pairs
        for (tool, jaw, target_kind), gap_m in world.gaps_m().items():
            found = deepest_touches(pairs, tool, target_kind)[jaw - JAW_A]
            if abs(gap_m - GRASP_GAP_M) < CLOSE_M:
                continue
            touches = tool in looks and gap_m < GRASP_GAP_M
            assert (found >= 0) == touches, (kind, tool, jaw, target_kind, gap_m)
            seen[touches] += 1
            if touches:
                radius_m = RADIUS_M[tool, jaw] + (HALF_M if target_kind == DUCT_TRIANGLE else CATHETER_M)
                assert pairs.gap_m[found] == pytest.approx(gap_m, abs=CLOSE_M)
                apart_m = np.linalg.norm(world.axis_m(found) - world.point_m(found))
                assert apart_m - radius_m == pytest.approx(gap_m, abs=CLOSE_M)
        assert not any(pairs.tool_segment[i] not in (JAW_A, JAW_B) for i in range(pairs.count))
        assert (pairs.dropped, world.touches.dropped) == (0, 0)
    assert min(seen.values()) > 100


def test_nothing_is_touched_before_physics_has_spoken_nor_once_the_scene_begins_again() -> None:
    world = World(wall("straight"), 3)
    middle_m = world.vertices_m[world.duct.mesh.triangles[100]].mean(axis=0)
    world.segments_m[:] = middle_m
    found = []
    for _ in range(2):
        world.touches.find([0, 1], world.segments_m, world.scene)
        found.append(world.touches.pairs.count)
        world.scene.forget()
        world.touches.forget()
        assert world.touches.pairs.count == 0
    assert found[0] >= 4
    assert found[1] == 0


def test_what_is_touched_does_not_depend_on_what_was_before() -> None:
    """A scene that begins again, or is replayed from another tick, must find the same to the bit."""
    world = World(wall("straight"), 11)
    for _ in range(40):
        world.move()
        world.touches.find([0, 1], world.segments_m, world.scene)
        fresh = JawTouches(SCENE, world.duct, RADIUS_M)
        fresh.find([0, 1], world.segments_m, world.scene)
        n = world.touches.pairs.count
        assert fresh.pairs.count == n
        for name in ("tool", "tool_segment", "target_kind", "target", "tool_parameter", "target_weights", "gap_m"):
            np.testing.assert_array_equal(getattr(world.touches.pairs, name)[:n], getattr(fresh.pairs, name)[:n])
