"""The price of a step finds what ends too deep and has no row, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.collision.candidates import SAME_POINT
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL
from trocar.services.mechanics.contact.identity import TARGET, TARGET_KIND, part_of
from trocar.services.mechanics.contact.price import MAX_NEW_ROWS, VIOLATION_SPACING, piece_of
from trocar.services.mechanics.contact.working_set import N_TOOL_PIECES
from trocar.services.mechanics.scene import QualityLevel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation, step_solver
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.judge.closest import point_triangle, segment_triangle
from trocar.studies.judge.overlaps import OverlapJudge

SLACK_M, TICKS, DEEPEST_M = 1e-8, 60, 40e-6


class PriceJudge:
    """Holds the last price of an accepted step against brute force over what is drawn where the step ends.

    Ends that are priced and left are not judged, of a step as of its solves: there bodies may have outrun detection.
    """

    def __init__(self, simulation):
        self._simulation, self._price, self._move = simulation, simulation.search.price, simulation._move
        self.found = self.prices = 0
        simulation.search.price, simulation._move = self._look, self._judge

    def _judge(self, *step):
        self._missed = []
        is_accepted = self._move(*step)
        assert not (is_accepted and self._missed), self._missed
        return is_accepted

    def _look(self, system, tolerance_m, pairs):
        before_m = system.rows.correction_m.copy()
        found, self._missed = self._price(system, tolerance_m, pairs), []
        ends, thickness_m, corners = self._drawn()
        on_wall = np.flatnonzero(pairs.target_kind[: pairs.count] == DUCT_TRIANGLE)
        written = [self._feature(pairs, k) for k in on_wall]
        points = np.einsum("kc,kci->ki", pairs.target_weights[on_wall], corners[pairs.target[on_wall]])
        if not self._simulation.contacts.has_room:
            return found
        assert found >= pairs.count
        is_full = pairs.count == MAX_NEW_ROWS  # violations beyond these count, and are written in the next price
        assert is_full or (found > pairs.count) == bool((system.rows.correction_m != before_m).any())  # so do corrected
        self.found, self.prices = self.found + found, self.prices + 1
        deep = self._too_deep(ends, thickness_m, corners, tolerance_m - SLACK_M)
        assert set(written) <= set(deep), "what is no deeper than the tolerance is a violation"
        if len(on_wall) == MAX_NEW_ROWS:
            return found
        known, at_m = self._rows_on_wall(corners)
        for (p, t), gap_m in deep.items():
            if gap_m < -tolerance_m - SLACK_M and (p, t) not in known:
                longer = max([1.5, *(self._stretch(corners, q) for _, q in written)])
                beside_m = points[[self._is_one_body(p, q) for q, _ in written]]
                near = _nearest_m(beside_m, corners[t]) < VIOLATION_SPACING * thickness_m[p] * longer
                same = _nearest_m(at_m[[p == q for q, _ in known]], corners[t]) < SAME_POINT * thickness_m[p] * longer
                if not (near or same):
                    self._missed.append(f"piece {p} ends {-1e6 * gap_m:.0f} um deep in triangle {t} and has no row")
        return found

    def _drawn(self):
        """Return ends of pieces (p, 2, 3) with zero thickness where none is, and corners of triangles (m, 3, 3)."""
        simulation = self._simulation
        tools, line = simulation.tools, simulation.catheter.state.position_m
        poses = tools.segments, tools.frame, tools.length_m
        before = [each.copy() for each in poses]
        tools.update_pose()
        segments = tools.segments.reshape(-1, 2, 3).copy()
        for pose, kept in zip(poses, before, strict=True):
            pose[:] = kept
        radius_m = np.where((tools.present & ~tools.disengaged)[:, None], tools.radius_m, 0.0)
        thickness_m = np.concatenate([radius_m.ravel(), np.full(len(line) - 1, simulation.catheter.radius_m)])
        thickness_m[thickness_m > 0.0] += 0.5 * simulation.scene.duct.thickness_m
        ends = np.concatenate([segments, np.stack([line[:-1], line[1:]], axis=1)])
        return ends, thickness_m, simulation.duct.surface_m()[simulation.duct.reduced.mesh.triangles]

    def _stretch(self, corners, t):
        """Return how many times as long an edge of a triangle is as at rest, where points are one by their distance."""
        mesh = self._simulation.duct.reduced.mesh
        now, rest = (each - np.roll(each, 1, axis=0) for each in (corners[t], mesh.vertices_m[mesh.triangles[t]]))
        return float((np.linalg.norm(now, axis=1) / np.linalg.norm(rest, axis=1)).max())

    @staticmethod
    def _too_deep(ends, thickness_m, corners, tolerance_m):
        """Return {(piece, triangle): gap}."""
        middle, deep = corners.mean(axis=1), {}
        around_m = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        for p in np.flatnonzero(thickness_m):
            start, axis = ends[p, 0], ends[p, 1] - ends[p, 0]
            s = np.clip((middle - start) @ axis / (axis @ axis), 0.0, 1.0)
            apart_m = np.linalg.norm(middle - start - s[:, None] * axis, axis=1) - around_m
            for t in np.flatnonzero(apart_m < thickness_m[p]):
                square = segment_triangle(tuple(start), tuple(ends[p, 1]), *map(tuple, corners[t]))[0]
                gap_m = float(np.sqrt(square)) - thickness_m[p]
                if gap_m < -tolerance_m:
                    deep[int(p), int(t)] = gap_m
        return deep

    @staticmethod
    def _feature(pairs, k):
        if pairs.tool[k] != NO_TOOL:
            return int(3 * pairs.tool[k] + pairs.tool_segment[k]), int(pairs.target[k])
        return int(N_TOOL_PIECES + pairs.particle[k]), int(pairs.target[k])

    def _rows_on_wall(self, corners):
        """Return pieces and triangles of the rows on the wall, and where their points (k, 3) are now."""
        rows = self._simulation.contacts
        on_wall = [k for k in range(rows.n_contacts) if rows.identity[k] >= 0]
        on_wall = [k for k in on_wall if part_of(rows.identity[k], TARGET_KIND) == DUCT_TRIANGLE]
        features = [(piece_of.py_func(rows, k), part_of(rows.identity[k], TARGET)) for k in on_wall]
        at_m = np.einsum("kc,kci->ki", rows.duct_weight[on_wall], corners[np.array([t for _, t in features], int)])
        return features, at_m

    @staticmethod
    def _is_one_body(p, q):
        return p == q if min(p, q) < N_TOOL_PIECES else abs(p - q) <= 1


@pytest.mark.parametrize("thickness_m", [1e-3, 0.2e-3])
@settings(max_examples=4, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), speed_m_s=st.sampled_from([0.1, 0.4, 0.8]))
@example(seed=10684717, speed_m_s=0.8)  # loads alone move the thin wall by 8 mm in a step
@example(seed=1920826369, speed_m_s=0.8)  # one of a step's solves, not its last, moves the wall by 5 mm
def test_a_price_finds_all_that_brute_force_finds(small_scene, ducts, thickness_m, seed, speed_m_s):
    """Tools pushed about in the wall and the catheter flung against it."""
    rng, duct = np.random.default_rng(seed), ducts(thickness_m)
    scene = replace(small_scene, duct=replace(small_scene.duct, thickness_m=thickness_m))
    simulation, tools = Simulation(scene, duct), ToolInputs()
    judge, hand_m = PriceJudge(simulation), np.array([[20e-3, 0.0, 21.5e-3], [30e-3, 3e-3, 21.5e-3]])
    tools.jaw_angle_rad[:] = 0.5
    for tick in range(TICKS):
        if tick % 15 == 0:
            way = rng.normal((0.0, 0.0, -1.5 if tick < 30 else 0.5), 1.0, (2, 3))
            way *= speed_m_s * 1e-3 / np.linalg.norm(way, axis=1, keepdims=True)
            simulation.catheter.state.velocity_m_s[1:] += rng.normal(size=3) * (0.0, 0.7, 0.7) * speed_m_s
        hand_m = hand_m + way
        tools.position_m[:] = hand_m
        simulation.step(tools)
    assert judge.prices > TICKS // 6


def _nearest_m(points_m, corners_m):
    """Return the least distance of points (k, 3) from a triangle, infinite without any."""
    return np.sqrt(min((point_triangle(tuple(x), *map(tuple, corners_m)) for x in points_m), default=np.inf))


class DepthJudge(PriceJudge):
    """Holds what a settled step leaves too deep against how deep it began, by brute force, over the tolerance."""

    def __init__(self, simulation):
        super().__init__(simulation)
        self._begin, self.deepening, self.kept = simulation.search.begin, 0.0, 0
        simulation.search.begin = self._note

    def _note(self, *step):
        self._begin(*step)
        self._began = self._drawn()

    def _look(self, system, tolerance_m, pairs):
        found = self._price(system, tolerance_m, pairs)
        if found == 0:
            for (p, t), gap_m in self._too_deep(*self._drawn(), tolerance_m).items():
                ends, thickness_m, corners = self._began
                square = segment_triangle(tuple(ends[p, 0]), tuple(ends[p, 1]), *map(tuple, corners[t]))[0]
                began_m = float(np.sqrt(square)) - thickness_m[p]
                self.kept += 1
                self.deepening = max(self.deepening, (min(began_m, -tolerance_m) - gap_m) / tolerance_m)
        return found

    def clearance_m(self):
        """Return how far the catheter is above the wall, by its particles in the duct."""
        line = self._simulation.catheter.state.position_m
        corners = self._simulation.duct.surface_m()[self._simulation.duct.reduced.mesh.triangles]
        apart = [min(point_triangle(tuple(x), *map(tuple, c)) for c in corners) for x in line[-6:]]
        return float(np.sqrt(min(apart))) - self._simulation.catheter.radius_m - 0.1e-3


@pytest.mark.parametrize(
    ("ticks_per_step", "thickness_m", "tolerance_m"), [(1, 1e-3, 30e-6), (2, 1e-3, 60e-6), (2, 0.2e-3, 25e-6)]
)
def test_a_longer_step_lets_pass_as_much_more_and_never_more_than_a_part_of_the_wall(
    small_scene, ducts, ticks_per_step, thickness_m, tolerance_m
):
    """Two of three steps of 2 ms were solved twice in the scene everything: its jaws ended 36 to 44 um deep."""
    quality = (QualityLevel(ticks_per_step=ticks_per_step),)
    scene = replace(small_scene, duct=replace(small_scene.duct, thickness_m=thickness_m), quality=quality)
    simulation, tools, asked_m = Simulation(scene, ducts(thickness_m)), ToolInputs(), []
    price = simulation.search.price
    simulation.search.price = lambda system, tolerance, pairs: (
        asked_m.append(tolerance) or price(system, tolerance, pairs)
    )
    tools.position_m[:] = (20e-3, 0.0, 21.5e-3), (30e-3, 3e-3, 21.5e-3)
    for _ in range(20):
        simulation.step(tools, ticks_per_step * 1e-3)
    assert asked_m
    assert asked_m[-1] == pytest.approx(tolerance_m)


def test_a_row_that_was_too_deep_ends_no_deeper_than_it_began(small_scene, ducts):
    """The catheter flung into a thin wall: 0.25 of the tolerance deeper, for rows that know their points, or 1.32."""
    duct = ducts(0.2e-3)
    scene = replace(small_scene, duct=replace(small_scene.duct, thickness_m=0.2e-3))
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[:] = False
    judge, rod = DepthJudge(simulation), simulation.catheter.state
    for tick in range(60):
        if tick % 6 == 0:
            rod.position_m[1:, 2] -= judge.clearance_m() + 50e-6
            rod.velocity_m_s[1:, 2] = -0.4
        simulation.step(tools)
    assert judge.kept > 10
    assert judge.deepening < 0.5


def test_a_tick_whose_solves_have_taken_their_budget_keeps_what_is_sound(small_scene, ducts, monkeypatch):
    """Parts, prices and linearisations multiply: where forceps crossed, a tick took 200 solves and 2.9 s.

    Here all of the motion is sound, so nothing is taken again.
    """
    simulation, tools, solves = Simulation(small_scene, ducts(1e-3)), ToolInputs(), []
    for tick in range(40):
        tools.position_m[:] = (20e-3, 0.0, 21.5e-3 - 0.1e-3 * tick), (30e-3, 3e-3, 21.5e-3 - 0.1e-3 * tick)
        simulation.step(tools)
    assert simulation.contacts.n_contacts > 0
    system, solver = simulation.system, simulation.solver
    solve = system.solve
    monkeypatch.setattr(system, "solve", lambda *effort: solves.append(1) or solve(*effort))
    monkeypatch.setattr(solver.pricing, "finds_violations", lambda: True)  # no price ever ends
    for budget, fewest, most in ((10**12, 9, 9), (1, 1, 1), (10 * solver.products, 3, 9)):
        monkeypatch.setattr(step_solver, "MOST_PRODUCTS", budget)
        solves.clear()
        simulation.step(tools)
        assert fewest <= len(solves) <= most


@pytest.fixture(scope="module")
def ducts(small_scene, cache_dir):
    def build(thickness_m):
        scene = replace(small_scene, duct=replace(small_scene.duct, thickness_m=thickness_m))
        return build_scene_duct(scene, cache_dir)

    return build


@pytest.mark.parametrize("speed_m_s", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("gap_m", [0.1e-3, 0.3e-3, 0.55e-3])
def test_what_flies_at_a_wall_that_nothing_touches_ends_no_deeper_than_the_tolerance(
    small_scene, small_duct, speed_m_s, gap_m
):
    """Nothing has a row before it is there; it goes up to 0.9 mm in the step in which it comes."""
    height_m = small_scene.duct.radius_m - 0.5 * small_scene.duct.thickness_m - gap_m
    catheter = replace(small_scene.catheter, anchor="free", length_m=20e-3, n_segments=10)
    catheter = replace(catheter, tip_position_m=(10e-3, height_m - 0.5 * catheter.outer_diameter_m, 0.0))
    simulation, tools = Simulation(replace(small_scene, catheter=catheter), small_duct), ToolInputs()
    tools.present[:] = False
    simulation.catheter.state.velocity_m_s[:, 1] = speed_m_s
    judge = OverlapJudge(simulation)
    for _ in range(6):
        simulation.step(tools)
        judge.look()
    assert judge.deepest["catheter"] < DEEPEST_M


@pytest.mark.parametrize("seed", range(6))
def test_a_tool_that_is_swept_across_a_catheter_ends_no_deeper_in_it_than_the_tolerance(small_scene, small_duct, seed):
    """Outside the duct, at half a metre a second to and fro: the place of contact runs along both."""
    catheter = replace(small_scene.catheter, tip_position_m=(60e-3, 0.0, 0.0))
    simulation, tools = Simulation(replace(small_scene, catheter=catheter), small_duct), ToolInputs()
    rng, judge, tools.present[1] = np.random.default_rng(seed), OverlapJudge(simulation), False
    start_m, way_m = np.array([66e-3, 3e-3, 8e-3]), rng.normal(size=3) * (0.3, 1.0, 0.3)
    tools.jaw_angle_rad[0], tools.roll_rad[0] = 0.3, rng.uniform(0.0, 3.0)
    for tick in range(200):
        swing = np.sin(2.0 * np.pi * tick / 100)
        tools.position_m[0] = start_m + swing * 8e-3 * way_m / np.linalg.norm(way_m)
        simulation.step(tools)
        judge.look()
    assert 0.0 < judge.deepest["tool in catheter"] < DEEPEST_M
