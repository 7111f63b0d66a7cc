import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.solver import CYCLING, solve_contacts
from trocar.services.mechanics.contact.stages import write_results
from trocar.services.mechanics.contact.writer import append_row

UNILATERAL, GRIP = number_of("unilateral"), number_of("grip")


def solve(W, free, law, limit, force=None, effort=(200, 1e-12)):
    rows = rows_of(law, limit)
    if force is not None:
        rows.force_n[:] = force.reshape(-1, 3)
    problem = ContactProblem.of(rows)
    problem.free[:] = free
    sweeps = solve_contacts(problem, W, effort)
    return rows.force_n.ravel(), problem.motion, sweeps


def rows_of(law, limit):
    """Contacts with a coefficient of friction or a largest force: each law reads its own."""
    rows = ContactRows.zeros(c=len(law))
    for number in law:
        append_row(rows, number, 0)
    rows.friction[:], rows.force_limit_n[:] = np.where(law == UNILATERAL, limit, 0.0), np.where(law == GRIP, limit, 0.0)
    return rows


def who_slides(law, limit, force):
    rows, slides = rows_of(law, limit), np.zeros(len(law), np.bool_)
    rows.force_n[:] = force.reshape(-1, 3)
    write_results(rows, slides, np.zeros_like(rows.force_n))
    return slides


def random_problem(seed, k=12, n_grips=2):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((3 * k, 60)) * np.linspace(1.0, 0.02, 60)
    W = 1e-3 * (J @ J.T) + 1e-6 * np.eye(3 * k)
    free = 1e-4 * rng.standard_normal(3 * k)
    free[::3] -= 5e-5
    law = np.full(k, UNILATERAL, np.int8)
    law[k - n_grips :] = GRIP
    limit = np.where(law == GRIP, 0.02, rng.uniform(0.0, 0.6, k))
    return W, free, law, limit


@pytest.mark.parametrize("seed", range(8))
def test_signorini_and_coulomb_hold_at_the_solution(seed):
    W, free, law, limit = random_problem(seed)
    force, motion, sweeps = solve(W, free, law, limit)
    assert sweeps < 200
    assert np.allclose(motion, W @ force + free, atol=1e-15)
    slides, seen = who_slides(law, limit, force), set()
    for block, mu in enumerate(limit):
        f, u = force[3 * block : 3 * block + 3], motion[3 * block : 3 * block + 3]
        seen.add((int(law[block]), bool(slides[block]), bool(f[0] > 0.0)))
        if law[block] == GRIP:
            assert np.linalg.norm(f[1:]) <= mu * (1 + 1e-9)
            assert abs(u[0]) < 1e-11
            assert slides[block] or np.linalg.norm(u) < 1e-11
            assert f[1:] @ u[1:] <= 1e-15
            continue
        assert f[0] >= 0.0
        assert u[0] > -1e-11
        assert abs(f[0] * u[0]) < 1e-12
        assert np.linalg.norm(f[1:]) <= mu * f[0] * (1 + 1e-9)
        if f[0] > 0.0 and slides[block] and mu > 0.0:
            assert f[1:] @ u[1:] <= 0.0
            assert abs(f[1] * u[2] - f[2] * u[1]) <= 1e-7 * np.linalg.norm(f[1:]) * np.linalg.norm(u[1:]) + 1e-18
        elif f[0] > 0.0 and mu > 0.0:
            assert np.linalg.norm(u[1:]) < 1e-11
    # Open contacts, and pressed ones that slide.
    assert {(UNILATERAL, False, False), (UNILATERAL, True, True)} <= seen


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=40)
@given(seeds, st.integers(1, 12))
def test_forces_are_in_their_cones_after_any_number_of_sweeps(seed, sweeps):
    W, free, law, limit = random_problem(seed)
    force, _, used = solve(W, free, law, limit, effort=(sweeps, 0.0))
    assert used >= sweeps  # more, while bodies are in each other
    for block, mu in enumerate(limit):
        f = force[3 * block : 3 * block + 3]
        bound = mu if law[block] == GRIP else mu * f[0]
        assert np.linalg.norm(f[1:]) <= bound * (1 + 1e-9)


@settings(max_examples=40)
@given(seeds)
def test_the_objective_never_rises_over_sweeps(seed):
    """Without friction a solve minimises 1/2 f W f + f u over forces that only push."""
    W, free, law, _ = random_problem(seed, n_grips=0)
    objective = [0.0]
    for sweeps in range(1, 13):
        force, _, _ = solve(W, free, law, np.zeros(len(law)), effort=(sweeps, 0.0))
        objective.append(float(0.5 * force @ W @ force + force @ free))
    assert objective[-1] < 0.0, "something is pressed"
    assert np.diff(objective).max() <= 1e-12 * abs(objective[-1])


@settings(max_examples=40)
@given(seeds)
def test_contacts_that_meet_give_no_work(seed):
    """What is pressed does not part in the same step, and what slips is braked: f u is never above zero."""
    W, free, law, limit = random_problem(seed)
    force, motion, _ = solve(W, free, law, limit)
    work = np.einsum("ij,ij->i", force.reshape(-1, 3), motion.reshape(-1, 3))
    assert work.max() <= 1e-12


def test_warm_start_from_the_solution_takes_one_sweep():
    W, free, law, limit = random_problem(1)
    force, _, cold = solve(W, free, law, limit)
    _, _, warm = solve(W, free, law, limit, force=force.copy(), effort=(200, 1e-6))
    assert cold > 2
    assert warm == 1


def test_two_jaws_on_one_place_share_its_force_as_their_softness_says_in_a_single_step():
    """Sweeps change the shares by less than a solve's tolerance, while the shares are a thousand times as far off."""
    softness, tolerance_n = 1e-6, 1e-6
    W = np.kron(np.ones((2, 2)), np.diag([1.7e-2, 0.6e-2, 1e-2])) + softness * np.eye(6)
    law, limit = np.full(2, UNILATERAL, np.int8), np.full(2, 0.3)
    shares = np.array([10e-3, 0.5e-3, -1e-3, 10e-3, -0.5e-3, 1e-3])
    solution = np.array([10e-3, 0.0, 0.0, 10e-3, 0.0, 0.0])
    force, motion, _ = solve(W, -W @ solution, law, limit, force=shares, effort=(200, tolerance_n))
    assert np.abs(force - solution).max() <= tolerance_n
    assert np.abs(motion).max() <= softness * tolerance_n


@pytest.mark.parametrize(("pull", "slides"), [(0.299, False), (0.301, True)])
def test_a_pressed_point_sticks_below_mu_n_and_slides_above(pull, slides):
    """1 N of pressure on a free particle of compliance c: the tangent pull is 0.3 N at the threshold."""
    c = 1e-3
    W = c * np.eye(3)
    free = c * np.array([-1.0, pull, 0.0])
    force, motion, _ = solve(W, free, np.zeros(1, np.int8), np.array([0.3]))
    assert force[0] == pytest.approx(1.0)
    assert force[1] == pytest.approx(-min(pull, 0.3))
    assert (abs(motion[1]) > 1e-9) == slides


def test_chain_of_rigidly_tied_contacts_converges_in_few_sweeps():
    """Contacts on a stiff rod: plain Gauss-Seidel needs hundreds of sweeps, the joint step a handful."""
    k = 20
    arc = np.linspace(0.0, 1.0, k)
    W = np.zeros((3 * k, 3 * k))
    W[::3, ::3] = 1e-2 * np.exp(-np.abs(arc[:, None] - arc) / 0.3)
    W[1::3, 1::3] = 1e-3
    W[2::3, 2::3] = 1e-2 * np.exp(-np.abs(arc[:, None] - arc) / 0.3)
    W += 1e-6 * np.eye(3 * k)
    free = np.zeros(3 * k)
    free[::3] = -1e-4
    free[1::3] = 2e-5
    _, motion, sweeps = solve(W, free, np.zeros(k, np.int8), np.full(k, 0.2), effort=(40, 1e-9))
    assert sweeps <= 30
    assert motion[::3].min() > -1e-10


def a_row_of_heavy_pushes(k=12):
    """Contacts along a body that one gives way with all others: each relaxed alone pushes its neighbours back in."""
    place = np.arange(k)
    W = np.kron(1e-2 * np.exp(-np.abs(place[:, None] - place) / 6.0), np.diag([1.0, 0.0, 0.0])) + 1e-7 * np.eye(3 * k)
    free = np.zeros(3 * k)
    free[::3] = -3e-4 * np.cos(0.9 * place) - 2e-4
    return W, free, np.full(k, UNILATERAL, np.int8), np.zeros(k)


def test_a_solve_that_is_allowed_one_sweep_leaves_no_overlap_that_a_person_could_see():
    """It goes on while places move by more than a thousandth of a millimetre a sweep: one sweep left a fifth of one."""
    W, free, law, limit = a_row_of_heavy_pushes()
    force, motion, sweeps = solve(W, free, law, limit, effort=(1, 1e-7))
    exact, _, _ = solve(W, free, law, limit, effort=(200, 1e-12))
    assert 1 < sweeps <= 30
    assert motion[::3].min() > -2e-6
    assert np.abs(force - exact).max() < 0.01 * exact.max()


def test_a_solve_that_is_allowed_one_sweep_takes_one_where_that_moves_nothing_far():
    W, free, law, limit = a_row_of_heavy_pushes()
    exact, _, _ = solve(W, free, law, limit, effort=(200, 1e-12))
    assert solve(W, free + 1e-8, law, limit, force=exact, effort=(1, 1e-12))[2] == 1


@pytest.mark.parametrize(("k", "mean"), [(12, 20), (40, 40)])
def test_contacts_that_open_one_after_the_other_do_so_between_two_sweeps(k, mean):
    """Stiffness over three decades, friction on all: sweeps close again what a Newton step has opened."""
    cost = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        J = rng.standard_normal((3 * k, 3 * k)) * np.geomspace(1.0, 1e-3, 3 * k)
        W, free = 1e-2 * (J @ J.T) + 1e-6 * np.eye(3 * k), 1e-3 * rng.standard_normal(3 * k)
        free[::3] -= 2e-4
        _, motion, sweeps = solve(W, free, np.full(k, UNILATERAL), np.full(k, 0.2), effort=(30, 1e-6))
        assert motion[::3].min() > -1e-6
        cost.append(sweeps)
    assert np.mean(cost) < mean
    assert max(cost) < CYCLING + 50


@pytest.mark.parametrize(("k", "softness"), [(50, np.geomspace(1.0, 0.03, 80)), (30, np.geomspace(1.0, 0.02, 60))])
def test_what_is_wedged_comes_apart_before_the_sweeps_run_out(k, softness):
    """Random bodies of a few soft and many stiff modes, pressed everywhere: sweeps and Newton steps alone creep.

    Of ten each one and two ended at the most sweeps, up to 8 um deep.
    """
    for seed in range(10):
        rng = np.random.default_rng(seed)
        J = rng.standard_normal((3 * k, len(softness))) * softness
        W = 1e-2 / len(softness) * (J @ J.T) + 1e-6 * np.eye(3 * k)
        free = 1e-4 * rng.standard_normal(3 * k)
        free[::3] -= 2e-4
        force, motion, sweeps = solve(W, free, np.full(k, UNILATERAL), np.full(k, 0.1), effort=(30, 1e-6))
        assert sweeps < CYCLING + 50
        assert motion[::3].min() > -1e-6
        assert np.allclose(motion, W @ force + free, atol=1e-12)
        pressed, rubbing = force[::3], np.hypot(force[1::3], force[2::3])
        assert pressed.min() >= 0.0
        assert np.all(rubbing <= 0.1 * pressed * (1.0 + 1e-9))
