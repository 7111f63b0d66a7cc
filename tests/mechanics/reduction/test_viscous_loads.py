"""Loads that lag behind what presses a viscoelastic wall, against the creep of its Prony series."""

import numpy as np
import pytest

from tests.mechanics.reduction.residual.node_blocks import between_nodes
from trocar.services.mechanics.reduction.residual.blocks import Residual
from trocar.services.mechanics.reduction.viscoelastic import PronySeries
from trocar.services.mechanics.reduction.viscous_loads import MOST_LEFT, ViscousLoads, relax_loads

DT_S, N_NODES = 1e-3, 50
SERIES = PronySeries((0.2, 0.15, 0.1), (0.1, 1.0, 10.0))


@pytest.fixture
def residual():
    half = np.random.default_rng(2).normal(size=(3 * N_NODES, 3 * N_NODES))
    full = (half @ half.T / (3 * N_NODES)).reshape(N_NODES, 3, N_NODES, 3).transpose(0, 2, 1, 3)
    return Residual.full(np.ascontiguousarray(full, np.float32))


class Pressed:
    """The lists of loads that a step writes and the relaxation changes."""

    def __init__(self, series, residual, capacity=60):
        self.loads = ViscousLoads(series, N_NODES, capacity)
        self.nodes, self.force = np.zeros(capacity, np.int32), np.zeros((capacity, 3))
        self.residual = residual

    def press(self, nodes, force, dt_s=DT_S):
        """Return p (n, 3) on all nodes."""
        k = len(nodes)
        self.nodes[:k], self.force[:k] = nodes, force
        self.loads.begin_step(dt_s)
        count = relax_loads(self.loads.address, self.nodes, self.force, k)
        acting = np.zeros((N_NODES, 3))
        np.add.at(acting, self.nodes[:count], self.force[:count])
        return acting

    def lag(self):
        nodes, force = self.loads.lasting
        total = np.zeros((N_NODES, 3))
        total[nodes] = force
        return total


def creep(series, t_s):
    """Creep of the Prony series under a unit load, by integrating its own law in short steps."""
    g, tau, lag, dt_s = np.array(series.g), np.array(series.tau_s), np.zeros(len(series.g)), 1e-4
    for _ in range(round(t_s / dt_s)):
        lag += dt_s * (1.0 + g @ lag - lag) / tau
    return 1.0 + g @ lag


@pytest.mark.parametrize("t_s", [0.05, 0.5, 3.0])
def test_a_dent_creeps_as_the_series_says(residual, t_s):
    pressed, force = Pressed(SERIES, residual), np.array([[0.1, 0.0, -0.2]])
    for _ in range(round(t_s / DT_S)):
        acting = pressed.press([7], force)
    np.testing.assert_allclose(acting[7], creep(SERIES, t_s) * force[0], rtol=3e-3)
    assert not np.delete(acting, 7, axis=0).any()


def test_a_step_that_is_taken_back_leaves_no_trace(residual):
    pressed, force = Pressed(SERIES, residual), np.array([[0.1, 0.0, -0.2], [0.0, 0.3, 0.0]])
    pressed.press([7, 2], force)
    pressed.loads.save_start()
    once, lag = pressed.press([7, 4], 2.0 * force), pressed.lag()
    pressed.press([11, 12, 13], np.ones((3, 3)))
    pressed.loads.restore_start()
    np.testing.assert_array_equal(pressed.press([7, 4], 2.0 * force), once)
    np.testing.assert_array_equal(pressed.lag(), lag)


def test_a_dent_ends_where_the_lasting_modulus_says(residual):
    pressed = Pressed(PronySeries((0.45,), (0.02,)), residual)
    for _ in range(1000):
        acting = pressed.press([3, 9], np.ones((2, 3)))
    np.testing.assert_allclose(acting[[3, 9]], 1.0 / 0.55, rtol=1e-9)


def test_first_it_is_elastic(residual):
    acting = Pressed(SERIES, residual).press([3], np.ones((1, 3)))
    np.testing.assert_array_equal(acting[3], 1.0)


def test_what_is_let_go_comes_back_and_is_forgotten(residual):
    pressed = Pressed(PronySeries((0.3,), (0.02,)), residual)
    for _ in range(50):
        pressed.press([3], np.ones((1, 3)))
    left = [pressed.press([], np.zeros((0, 3)))[3, 0] for _ in range(600)]
    assert 0.2 < left[0] < 0.5
    assert np.all(np.diff(left) <= 0.0)
    assert left[-1] == 0.0
    assert len(pressed.loads.lasting[0]) == 0


def test_of_many_places_left_those_that_lag_least_are_forgotten(residual):
    pressed = Pressed(SERIES, residual)
    for node in range(N_NODES):
        pressed.press([node], np.full((1, 3), 1.0 + node))
    nodes, _ = pressed.loads.lasting
    assert len(set(nodes)) == len(nodes) == MOST_LEFT + 1
    assert set(nodes) == set(range(N_NODES - MOST_LEFT - 1, N_NODES))


def test_few_contacts_that_wander_find_room_beside_all_that_lag(residual):
    pressed = Pressed(SERIES, residual, capacity=3)
    for node in range(0, N_NODES - 2, 3):
        acting = pressed.press([node, node + 1, node + 2], np.ones((3, 3)))
        np.testing.assert_array_equal(acting[node : node + 3], 1.0)
        lags = np.flatnonzero(pressed.lag().any(axis=1))
        assert len(lags) == min(node + 3, MOST_LEFT + 3)
        assert set(lags[-3:]) == {node, node + 1, node + 2}


@pytest.mark.parametrize(("dt_s", "changes_every"), [(1e-4, 8), (1e-3, 8), (5e-2, 8), (1e-3, 1)])
def test_work_is_stored_dissipated_or_lost_by_the_step(residual, dt_s, changes_every):
    """Loads at random: a force at the end of a step does the work of what is stored and half of the change in it."""
    random, pressed = np.random.default_rng(4), Pressed(SERIES, residual)
    R = between_nodes(residual, np.arange(N_NODES, dtype=np.int32))
    work, relaxed, lost, before = 0.0, 0.0, 0.0, np.zeros(3 * N_NODES)
    force = np.zeros((4, 3))
    for tick in range(1280):
        if tick % changes_every == 0:
            force = random.normal(size=(4, 3))
        acting = pressed.press([1, 2, 30, 31], force, dt_s).ravel()
        total = np.zeros((N_NODES, 3))
        total[[1, 2, 30, 31]] = force
        change = R @ (acting - before)
        work += total.ravel() @ change
        lost += 0.5 * (acting - before) @ change
        relaxed += pressed.loads.lost_j(residual.store, dt_s)
        before = acting
    stored = 0.5 * before @ R @ before + pressed.loads.extra_energy_j(residual.store)
    assert relaxed > 0.0
    assert work == pytest.approx(stored + relaxed + lost, rel=0.02)
