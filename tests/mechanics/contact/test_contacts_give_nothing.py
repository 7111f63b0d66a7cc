"""Contacts give nothing: neither where overlaps are taken back, nor where the solve is cut short."""

import numpy as np
import pytest

from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.contact.free_motion import effective_gap, free_motion, sunk_at_end
from trocar.services.mechanics.contact.identity import pair_identity
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.passivity import (
    CREDIT,
    RECENT_S,
    SLACK_J,
    START_UP_S,
    Ledger,
    limit_recovery,
    solve_passively,
    within_credit,
)
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import KEPT, ContactRows
from trocar.services.mechanics.contact.solver import solve_contacts
from trocar.services.mechanics.contact.writer import append_row

RECOVERY, DT_S = 0.2, 1e-3


class Pressed:
    """Random contacts under random loads, tied together by a random compliance; some of them overlap."""

    def __init__(self, seed, k=12, deep_m=0.3e-3, pressed_m=1e-4):
        random = np.random.default_rng(seed)
        self.rows = ContactRows.zeros(c=k)
        self.problem = ContactProblem.of(self.rows)
        for row in range(k):
            append_row(self.rows, number_of("unilateral"), pair_identity(-1, 0, row, 0, row))
        rows = self.rows
        rows.frame[:] = np.linalg.qr(random.normal(size=(k, 3, 3)))[0]
        rows.gap_m[:] = random.uniform(-deep_m, 0.0, k)
        rows.friction[:] = random.uniform(0.0, 0.6, k)
        rows.slip_m[:] = -pressed_m * random.random((k, 1)) * rows.frame[:, 0] + 1e-6 * random.normal(size=(k, 3))
        half = random.normal(size=(3 * k, 8))
        self.bodies_m_n = 1e-3 * half @ half.T / 8.0
        self.W = self.bodies_m_n + np.diag(rows.softness_m_n.ravel())
        self.ledger = Ledger.zeros(contact_time_s=START_UP_S)
        free_motion(rows, RECOVERY, DT_S, self.problem.free)

    def solve(self, how, sweeps=30):
        more = (self.ledger, (ToolArrays.zeros(), DT_S)) if how is solve_passively else ()
        how(self.problem, self.W, (sweeps, 1e-10), *more)
        return self

    def contact_work_j(self):
        """Work on the bodies, from their own motion, and what the springs of friction and surfaces have more."""
        rows, force = self.rows, self.rows.force_n
        creep_m_n, before_m = rows.softness_m_n[:, 0], rows.sunk_m
        after_m = (1.0 - RECOVERY) * before_m + creep_m_n * force[:, 0]
        sprung_j = 0.5 * float(np.sum(RECOVERY / creep_m_n * (after_m**2 - before_m**2)))
        slip_m = np.einsum("kij,kj->ki", rows.frame, rows.slip_m)
        moved_m = (self.bodies_m_n @ force.ravel()).reshape(-1, 3) + slip_m
        sprung_j += 0.5 * float(np.sum(rows.softness_m_n[:, 1:] * force[:, 1:] ** 2))
        return float(np.sum(force * moved_m)) + sprung_j


@pytest.mark.parametrize("sweeps", [30, 1])
def test_contacts_give_nothing(sweeps):
    cases = [(seed, pressed_m) for seed in range(50) for pressed_m in (1e-4, 1e-5)]
    plain_j = [Pressed(seed, pressed_m=m).solve(solve_contacts, sweeps).contact_work_j() for seed, m in cases]
    assert max(plain_j) > 1e-6
    for seed, pressed_m in cases:
        pressed = Pressed(seed, pressed_m=pressed_m).solve(solve_passively, sweeps)
        force = pressed.rows.force_n
        assert pressed.contact_work_j() <= 1.01 * SLACK_J
        assert (force[:, 0] >= 0.0).all()
        given = pressed.rows.pressure_n
        pressure_n = np.where(given <= KEPT, KEPT - given, force[:, 0])
        assert (np.hypot(force[:, 1], force[:, 2]) <= pressed.rows.friction * pressure_n * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("most_sweeps", [0, 2, 8, 20])
def test_contacts_give_nothing_where_there_is_no_work_left_to_solve_them(most_sweeps):
    for seed in range(50):
        pressed = Pressed(seed)
        pressed.problem.products_left = float(most_sweeps * pressed.rows.n_contacts**2)
        pressed.solve(solve_passively)
        assert pressed.contact_work_j() <= 1.01 * SLACK_J
        assert (pressed.rows.force_n[:, 0] >= 0.0).all()


def test_what_is_paid_for_is_taken_back():
    """A block pressed at 1 N, 0.1 mm deep, slides: friction takes more than 20 um of taking back give."""
    for slip_m, share in ((0.1e-3, 1.0), (0.0, 0.0)):
        pressed = Pressed(0, k=1)
        rows = pressed.rows
        rows.gap_m[0], rows.friction[0] = -0.1e-3, 0.5
        rows.slip_m[0] = -1e-3 * rows.frame[0, 0] + (1e-6 + slip_m) * rows.frame[0, 1]
        pressed.bodies_m_n = np.diag([1e-3, 1e-9, 1e-9])
        pressed.W = pressed.bodies_m_n + np.diag(rows.softness_m_n[0])
        free_motion(rows, RECOVERY, DT_S, pressed.problem.free)
        pressed.solve(solve_passively)
        assert rows.force_n[0, 0] == pytest.approx(1.0, rel=0.03)
        # What the surfaces' own softness takes, 1 uJ, pays for another micrometre.
        assert rows.effective_gap_m[0] == pytest.approx(share * effective_gap(rows, 0, RECOVERY, DT_S), abs=2e-6)


def test_a_shallow_overlap_is_taken_back_beside_a_deep_one():
    """Two blocks under the same load; what friction of the first pays for is enough for the shallow one."""
    pressed = Pressed(0, k=2)
    rows = pressed.rows
    rows.gap_m[:], rows.friction[:] = (-1e-6, -1e-3), (0.5, 0.0)
    rows.slip_m[:] = -1e-3 * rows.frame[:, 0]
    rows.slip_m[0] += 20e-6 * rows.frame[0, 1]
    pressed.bodies_m_n = np.diag([1e-3, 1e-9, 1e-9] * 2)
    pressed.W = pressed.bodies_m_n + np.diag(rows.softness_m_n.ravel())
    free_motion(rows, RECOVERY, DT_S, pressed.problem.free)
    asked_m = rows.effective_gap_m.copy()
    pressed.solve(solve_passively)
    assert rows.effective_gap_m[0] == asked_m[0]
    assert 0.0 > rows.effective_gap_m[1] > asked_m[1]
    assert pressed.contact_work_j() <= 1.01 * SLACK_J


def test_a_row_without_a_gap_has_nothing_to_take_back():
    """A hold in a row that was a deep contact a step ago: its motion is its slip, whatever is limited."""
    pressed = Pressed(0, k=2)
    pressed.rows.effective_gap_m[1] = -1e-3
    pressed.rows.law[1] = number_of("grip")
    free_motion(pressed.rows, RECOVERY, DT_S, pressed.problem.free)
    free_m = pressed.problem.free.copy()
    assert limit_recovery(pressed.rows, 0.0, pressed.problem.free)
    assert pressed.problem.free[0] > free_m[0]
    np.testing.assert_array_equal(pressed.problem.free[3:], free_m[3:])


def test_what_a_force_has_pressed_comes_back_and_no_more_than_that_without_a_budget():
    """A block is pressed at 2 N, then at 1 N, 0.1 mm deeper than that has pressed it: a spring beside a damper."""
    pressed = Pressed(0, k=1)
    rows, stiffness_n_m, damping_n_s_m = pressed.rows, 0.2 / 1e-6, 1e-3 / 1e-6
    pressed.bodies_m_n = np.diag([1e-3, 1e-9, 1e-9])
    pressed.W = pressed.bodies_m_n + np.diag(rows.softness_m_n[0])
    rows.friction[0], unpaid_m, depth_m = 0.0, 0.1e-3, 0.1e-3
    for step in range(200):
        load_n = 2.0 if step < 100 else 1.0
        rows.gap_m[0], rows.force_n[0] = -depth_m, 0.0
        before_m = rows.sunk_m[0]
        rows.slip_m[0] = -1e-3 * load_n * rows.frame[0, 0]
        free_motion(rows, RECOVERY, DT_S, pressed.problem.free)
        pressed.ledger.n_solves = 0
        pressed.solve(solve_passively)
        force_n = rows.force_n[0, 0]
        depth_m -= 1e-3 * (force_n - load_n)
        rows.sunk_m[0] = sunk_at_end(rows, 0)
        assert 0.09e-3 < depth_m - rows.sunk_m[0] < unpaid_m + 1e-12  # less by what the damper pays for
        unpaid_m = depth_m - rows.sunk_m[0]
        rate_m_s = (rows.sunk_m[0] - before_m) / DT_S
        assert force_n == pytest.approx(stiffness_n_m * before_m + damping_n_s_m * rate_m_s, rel=1e-6)
        if step == 99:
            assert depth_m == pytest.approx(unpaid_m + 5e-6 * 2.0, abs=1e-10)
    assert depth_m == pytest.approx(unpaid_m + 5e-6 * 1.0, abs=1e-10)


def test_a_step_that_is_solved_again_is_entered_once():
    """As where the catheter's step is planned again, or looked at where it ends: what was solved first never was."""
    pressed, tools = Pressed(0), ToolArrays.zeros(present=np.array([True, False]))
    tools.stiffness[0], tools.stretch[0], tools.hand[0] = 1000.0, -1e-3, 2e-3
    pressed.ledger.contact_time_s = 0.0
    entered = []
    for step in range(1, 3):
        pressed.ledger.n_solves = 0
        for _ in range(4):
            free_motion(pressed.rows, RECOVERY, DT_S, pressed.problem.free)
            solve_passively(pressed.problem, pressed.W, (30, 1e-10), pressed.ledger, (tools, DT_S))
            ledger = pressed.ledger
            entered.append((ledger.hand_work_j, ledger.max_hand_work_j, ledger.contact_time_s))
        assert entered[-4:] == [entered[-4]] * 4
        assert ledger.contact_time_s == step * DT_S
    assert entered[-1][0] == pytest.approx((1.0 + (1.0 - DT_S / RECENT_S)) * 4 * 1000.0 * 1e-3 * 2e-3)


@pytest.mark.parametrize(
    ("tool", "gap_m", "gives_j"),
    [(0, -5e-6 - 3e-15, 0.6e-15), (0, -10e-6, 1e-6), (-1, -5e-6 - 3e-15, 0.6e-15), (-1, -10e-6, 0.0)],
)
def test_what_a_step_may_give_is_not_owed(tool, gap_m, gives_j):
    """A tool's contacts may use a share of the hands' work; a catheter left alone would swing with it.

    Its surfaces are as deep in each other as 1 N presses them, and what is deeper stays: nothing creeps under load.
    """
    pressed = Pressed(0, k=1)
    rows = pressed.rows
    rows.tool[0], rows.gap_m[0], rows.sunk_m[0], rows.friction[0] = tool, gap_m, 5e-6, 0.0
    rows.slip_m[0] = -1e-3 * rows.frame[0, 0]
    pressed.bodies_m_n = np.diag([1e-3, 1e-9, 1e-9])
    pressed.W = pressed.bodies_m_n + np.diag(rows.softness_m_n[0])
    free_motion(rows, RECOVERY, DT_S, pressed.problem.free)
    pressed.ledger.max_hand_work_j = 1.0
    contact_work_j = pressed.solve(solve_passively).contact_work_j()
    assert contact_work_j == pytest.approx(gives_j, rel=0.02, abs=1e-17)
    assert pressed.ledger.debt_j == pytest.approx(max(contact_work_j - SLACK_J, 0.0), abs=1e-18)


@pytest.mark.parametrize(
    ("n_solves", "debt_j", "begun_j", "is_within"),
    [
        (0, 9e-6, 0.0, True),  # no contact: what is owed is of earlier steps
        (2, 1.9e-6, 0.0, True),
        (2, 2.1e-6, 0.0, False),
        (1, 5e-6, 5e-6, True),  # a step that adds nothing to a debt
        (1, 5e-6, 4.9e-6, False),
    ],
)
def test_a_step_may_owe_a_part_of_the_hands_work_or_what_it_began_with(n_solves, debt_j, begun_j, is_within):
    ledger = Ledger.zeros(n_solves=n_solves, debt_j=debt_j, max_hand_work_j=2e-6 / CREDIT)
    ledger.at_start[1] = begun_j
    assert within_credit(ledger) is is_within
