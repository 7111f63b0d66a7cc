"""W between contact points from blocks that are kept: the same as gathered anew, whatever has been touched before."""

import numpy as np
import pytest

from trocar.services.mechanics.reduction.node_compliance import NodeCompliance

N_POINTS = 9


@pytest.fixture
def points_on(duct):
    def draw(seed):
        rng = np.random.default_rng(seed)
        corners = rng.choice(duct.mesh.triangles[:200], N_POINTS, replace=False).astype(np.int32)
        weights = rng.dirichlet(np.ones(3), N_POINTS)
        weights[0, 0], weights[0, 1:] = 0.0, (0.25, 0.75)
        weights[1] = 0.0  # a contact that is not on the duct
        return corners, weights

    return draw


def loads_on(points, seed=0):
    nodes = np.unique(points[0])[:7].astype(np.int32)
    return nodes, np.random.default_rng(seed).normal(size=(len(nodes), 3))


def dense(duct, points, gain):
    """B C B^T with the whole C = Phi diag(gain) Phi^T + R, and |B| |C| |B|^T, by which rounding of C is bounded.

    R is made symmetric: its blocks are rounded one by one.
    """
    n = duct.basis.n_nodes
    R = np.asarray(duct.residual.blocks, np.float64).reshape(n, n, 3, 3).transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)
    Phi = duct.basis.Phi.reshape(3 * n, -1)
    B = np.zeros((N_POINTS, 3, n, 3))
    for point, (corners, weights) in enumerate(zip(*points, strict=True)):
        for corner, weight in zip(corners, weights, strict=True):
            B[point, :, corner] += weight * np.eye(3)
    B, C = B.reshape(3 * N_POINTS, -1), (Phi * gain) @ Phi.T + 0.5 * (R + R.T)
    return B @ C @ B.T, abs(B) @ abs(C) @ abs(B).T


def gathered(kept, points, gain, most_ticks=100):
    """W of ``points``, after as many ticks as it takes, and how many those were."""
    for tick in range(most_ticks):
        displace(kept, points, loads_on(points))
        W = np.full((3 * N_POINTS, 3 * N_POINTS), np.nan)
        if kept.gather(points, gain, W, 0):
            rows, columns = np.indices(W.shape) // 3
            return np.where(columns <= rows, W, 0.0), tick
        assert np.isnan(W).all()
    raise AssertionError("never complete")


def displace(kept, points, loads):
    out = np.zeros((2, N_POINTS, 3))
    assert kept.displace(points, loads, (out[0], out[1]))
    return out


@pytest.fixture
def gain(duct):
    return np.random.default_rng(8).uniform(-0.2, 1.0, duct.basis.n_modes) * 1e-6


def test_it_is_the_compliance_of_modes_and_residual_in_single_precision(duct, points_on, gain):
    points = points_on(1)
    W, _ = gathered(NodeCompliance(duct, 30), points, gain)
    expected, size = dense(duct, points, gain)
    rows, columns = np.indices(W.shape) // 3
    half_a_bit = 2.0**-24 * (1.0 + 1e-6)
    assert (abs(W - expected) <= half_a_bit * size)[columns <= rows].all()


@pytest.mark.parametrize("n_places", [128, 30])
def test_it_does_not_depend_on_what_was_touched_before(duct, points_on, gain, n_places):
    """Thirty places are hardly more than one tick's nodes: they are taken from nodes touched before."""
    kept = NodeCompliance(duct, 30, n_places)
    for seed in range(2, 80):
        displace(kept, points_on(seed), loads_on(points_on(seed)))
        kept.gather(points_on(seed), gain, np.empty((3 * N_POINTS, 3 * N_POINTS)), 0)
    W, _ = gathered(kept, points_on(99), gain)
    anew, _ = gathered(NodeCompliance(duct, 30), points_on(99), gain)
    np.testing.assert_array_equal(W, anew)


def test_another_gain_makes_it_anew(duct, points_on, gain):
    points, kept = points_on(3), NodeCompliance(duct, 30)
    gathered(kept, points, gain)
    for changed in (gain, 1.5 * gain, np.append(gain[:-1], 0.0)):
        W, _ = gathered(kept, points, changed)
        anew, _ = gathered(NodeCompliance(duct, 30), points, changed)
        np.testing.assert_array_equal(W, anew)


def test_a_tick_computes_a_bounded_number_of_blocks(duct, gain):
    rng, kept = np.random.default_rng(5), NodeCompliance(duct, 30)
    corners = rng.permutation(duct.basis.n_nodes)[:90].reshape(30, 3).astype(np.int32)
    points, W = (corners, np.full((30, 3), 1.0 / 3.0)), np.empty((90, 90))
    out = np.zeros((2, 30, 3))
    done, ticks = False, 0
    while not done:
        assert kept.displace(points, loads_on(points), (out[0], out[1]))
        done, ticks = kept.gather(points, gain, W, 0), ticks + 1
    assert 90 * 91 / 2 / (400 + 90) < ticks <= 90 * 91 / 2 / 400 + 1


def test_more_nodes_than_places_are_refused(duct, points_on, gain):
    kept, points = NodeCompliance(duct, 30, 10), points_on(6)
    out = np.zeros((2, N_POINTS, 3))
    assert not kept.displace(points, loads_on(points), (out[0], out[1]))
    assert not kept.gather(points, gain, np.empty((3 * N_POINTS, 3 * N_POINTS)), 0)
    assert not out.any()


def test_residual_displacements_of_points_are_those_of_the_residual(duct, points_on):
    """To the last bit: in which order loads are added is the same."""
    kept = NodeCompliance(duct, 30)
    for seed in (11, 12, 11):
        points = points_on(seed)
        loads = loads_on(points_on(seed + 1), seed)
        moved, change = displace(kept, points, loads)
        at_corners = np.zeros((3 * N_POINTS, 3))
        duct.residual.apply(loads[0], loads[1], points[0].ravel(), at_corners)
        expected = np.zeros((N_POINTS, 3))
        for corner in range(3):
            expected += points[1][:, corner, None] * at_corners.reshape(N_POINTS, 3, 3)[:, corner]
        np.testing.assert_array_equal(moved, expected)
        np.testing.assert_array_equal(change, -expected)


def test_steady_forces_move_nothing(duct, points_on):
    """What they moved points by is what W says they move them by, to the last bits: else what sticks creeps, by the
    difference in every step. With W in single precision that was a part in ten million."""
    points, kept = points_on(4), NodeCompliance(duct, 30)
    W, _ = gathered(kept, points, np.zeros(duct.basis.n_modes))
    W = np.tril(W) + np.tril(W, -1).T
    force = np.random.default_rng(5).normal(size=(N_POINTS, 3))
    nodes = np.unique(points[0]).astype(np.int32)
    spread = np.zeros((len(nodes), 3))
    for corners, weights, each in zip(*points, force, strict=True):
        spread[np.searchsorted(nodes, corners)] += weights[:, None] * each
    moved = displace(kept, points, (nodes, spread))[0]
    assert moved.ravel() == pytest.approx(W @ force.ravel(), abs=1e-14 * abs(moved).max())
