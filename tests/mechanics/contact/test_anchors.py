"""Friction with memory: what sticks stays, what slides obeys Coulomb, at any step."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE
from trocar.services.mechanics.contact.engagement import CLEAR_M
from trocar.services.mechanics.contact.free_motion import free_motion
from trocar.services.mechanics.contact.identity import pair_identity
from trocar.services.mechanics.contact.laws import CREEP_M_S_N, SURFACE_SOFTNESS_M_N, number_of
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.solver import solve_contacts
from trocar.services.mechanics.contact.stages import write_results
from trocar.services.mechanics.contact.warm_start import (
    ENDED_M,
    ForceMemory,
    recall_forces,
    store_anchors,
    store_forces,
)
from trocar.services.mechanics.contact.writer import append_row
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.judge.overlaps import OverlapJudge
from trocar.studies.stability.drive import reduced_duct
from trocar.studies.stability.families.abuse import KINDS
from trocar.studies.stability.family import Draw, Reach
from trocar.studies.stability.situations import LEAD_STEPS

STEPS_S = (1e-3, 2.5e-4, 1e-4)


_NO_WALL = np.zeros((1, 3))


class Block:
    """A block of 1 kg on an incline, its contact hopping from triangle to triangle, its tangents turning."""

    def __init__(self, slope, mu, dt_s):
        self.mu, self.dt_s, self.tick = mu, dt_s, 0
        self.load_n = 9.81 * np.array([-np.cos(slope), np.sin(slope), 0.0])
        self.x, self.v = np.zeros(3), np.zeros(3)
        self.rows = ContactRows.zeros(c=1)
        self.memory, self.slides = ForceMemory.zeros(c=1), np.zeros(1, np.bool_)
        self.problem = ContactProblem.of(self.rows)

    def step(self):
        rows, gain = self.rows, self.dt_s**2
        rows.n_contacts = 0
        append_row(rows, number_of("unilateral"), pair_identity(-1, 0, 0, 0, self.tick))
        c, s = np.cos(0.3 * self.tick), np.sin(0.3 * self.tick)
        rows.frame[0] = [[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]
        motion = self.dt_s * self.v + gain * self.load_n
        rows.slip_m[0], rows.friction[0], rows.softness_m_n[0, 0] = motion, self.mu, 0.0
        recall_forces(self.memory, rows, _NO_WALL)
        free_motion(rows, 0.2, self.dt_s, self.problem.free)
        W = np.diag(gain + rows.softness_m_n[0])
        solve_contacts(self.problem, W, (30, 1e-12))
        force = np.zeros((1, 3))
        write_results(rows, self.slides, force)
        store_forces(self.memory, rows, force, _NO_WALL)
        store_anchors(self.problem, self.slides, self.memory.elastic_m)
        motion += gain * force[0]
        self.x += motion
        self.v = motion / self.dt_s
        self.tick += 1
        return force[0]


def test_what_is_remembered_goes_with_the_place_on_the_wall_not_with_the_triangle():
    """A jaw across two edges: each belongs to two triangles, and is now of the one, now of the other."""
    vertices_m = np.array([[0.0, 0.0, 0.0], [2e-3, 0.0, 0.0], [0.0, 2e-3, 0.0]])
    at_one, at_other = [0.5, 0.5, 0.0], [0.5, 0.0, 0.5]

    def rows_of(*contacts):
        rows = ContactRows.zeros(c=3)
        for row, (triangle, weights) in enumerate(contacts):
            append_row(rows, number_of("unilateral"), pair_identity(0, 1, -1, DUCT_TRIANGLE, triangle))
            rows.frame[row], rows.duct_node[row], rows.duct_weight[row] = np.eye(3), (0, 1, 2), weights
        return rows

    memory = ForceMemory.zeros(c=3)
    force_n = np.array([[1.0, 0.1, 0.0], [2.0, 0.0, 0.2], [0.0, 0.0, 0.0]])
    store_forces(memory, rows_of((5, at_one), (6, at_other)), force_n, vertices_m)
    memory.elastic_m[:2] = -1e-9 * force_n[:2]
    rows = rows_of((6, at_one), (7, at_other))
    recall_forces(memory, rows, vertices_m)
    assert rows.force_n[:2] == pytest.approx(force_n[:2])
    assert rows.elastic_m[:2] == pytest.approx(-1e-9 * force_n[:2])
    slid = rows_of((9, [0.0, 0.2, 0.8]), (9, [0.2, 0.8, 0.0]), (9, [0.3, 0.3, 0.4]))
    recall_forces(memory, slid, vertices_m)
    assert slid.force_n[:, 0] == pytest.approx([2.0, 1.0, 0.0]), "the nearest, and each once"


@pytest.mark.parametrize(("least_n", "dt_s", "goes_on"), [(1e-3, 1e-3, True), (0.5, 1e-3, False), (1e-3, 5e-4, False)])
def test_a_row_begins_with_the_force_to_be_expected_after_steady_changes_only(least_n, dt_s, goes_on):
    """Not where changes are as small as errors of a solve, and not in a step of another length."""
    memory, change_n = ForceMemory.zeros(c=1), np.array([0.1, 0.0, -0.02])
    memory.least_change_n = least_n

    def begin(length_s):
        rows = ContactRows.zeros(c=1)
        rows.dt_s = length_s
        append_row(rows, number_of("unilateral"), pair_identity(-1, 0, 0, 0, 0))
        rows.frame[0] = np.eye(3)
        recall_forces(memory, rows, _NO_WALL)
        return rows

    for tick in range(4):
        rows, force_n = begin(1e-3), np.array([[1.0, 0.0, 0.0]]) + tick * change_n
        store_forces(memory, rows, force_n, _NO_WALL)
    rows = begin(dt_s)
    assert rows.force_n[0] == pytest.approx(force_n[0] + (change_n if goes_on else 0.0))
    assert rows.friction_energy_j[0] == pytest.approx(0.5 * SURFACE_SOFTNESS_M_N * force_n[0, 2] ** 2)
    store_forces(memory, rows, force_n - 0.5, _NO_WALL)
    assert begin(dt_s).force_n[0] == pytest.approx(force_n[0] - 0.5), "it was wrong"


@pytest.mark.parametrize("residual_m", [(0.0, 3e-7), (-2e-7, 1e-7), (3e-4, 0.0), (0.0, -2e-3)])
def test_an_anchor_stretches_no_further_than_the_cone_bears_wherever_a_solve_ended(residual_m):
    """A solve that was cut short leaves surfaces that stick by its forces, and have moved on by its motion."""
    rows, memory, mu, normal_n = ContactRows.zeros(c=1), ForceMemory.zeros(c=1), 0.5, 2.0
    append_row(rows, number_of("unilateral"), pair_identity(-1, 0, 0, 0, 0))
    rows.frame[0], rows.friction[0], rows.force_n[0] = np.eye(3), mu, (normal_n, 0.1, -0.2)
    problem = ContactProblem.of(rows)
    problem.motion[1:3] = residual_m
    store_anchors(problem, np.zeros(1, np.bool_), memory.elastic_m)
    wanted_m = np.array(residual_m) - SURFACE_SOFTNESS_M_N * rows.force_n[0, 1:]
    most_m = SURFACE_SOFTNESS_M_N * mu * normal_n + ENDED_M
    share = min(1.0, most_m / np.linalg.norm(wanted_m))
    assert memory.elastic_m[0] == pytest.approx([0.0, *(share * wanted_m)], rel=1e-12)


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_a_block_on_an_incline_below_the_angle_of_friction_rests_on_the_stiffness_of_the_surfaces(dt_s):
    block = Block(0.3, 0.7, dt_s)
    for _ in range(4000):
        force = block.step()
    rest_m = SURFACE_SOFTNESS_M_N * block.load_n[1]
    assert block.x[1] == pytest.approx(rest_m, rel=1e-6)
    assert force[1] == pytest.approx(-block.load_n[1], rel=1e-6)
    before = block.x[1]
    for _ in range(500):
        block.step()
    assert abs(block.x[1] - before) * 60.0 / (500 * dt_s) < 1e-9


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_a_block_on_a_steeper_incline_slides_with_what_coulomb_leaves_of_its_weight(dt_s):
    slope, mu = 0.5, 0.4
    block, n = Block(slope, mu, dt_s), round(0.2 / dt_s)
    for _ in range(round(0.02 / dt_s)):  # the surfaces take up the first few micrometres
        block.step()
    start_m_s = block.v[1]
    for _ in range(n):
        block.step()
    speed_m_s = 9.81 * (np.sin(slope) - mu * np.cos(slope)) * n * dt_s
    assert block.v[1] - start_m_s == pytest.approx(speed_m_s, rel=1e-6)


def test_a_catheter_that_sticks_to_a_slope_does_not_creep(with_effects, small_duct):
    """Settled in thick oil, then watched: less than 0.1 um in a minute."""
    tilt, normal = np.arctan(0.35), np.array([0.0, -np.sin(np.pi / 12), -np.cos(np.pi / 12)])
    g = 9.81 * (np.cos(tilt) * normal - [np.sin(tilt), 0.0, 0.0])
    scene = with_effects(gravity={"acceleration_m_s2": tuple(g)}, friction={"mu_static": 0.5, "mu_kinetic": 0.5})
    catheter = replace(
        scene.catheter,
        anchor="free",
        length_m=20e-3,
        n_segments=10,
        tip_position_m=(10e-3, *(2.45e-3 * normal[1:])),
        viscous_drag_n_s_m2=2.0,
    )
    # Each particle weighs 30 uN.
    scene = replace(scene, catheter=catheter, contact=replace(scene.contact, tolerance_n=1e-9))
    simulation, tools = Simulation(scene, small_duct), ToolInputs()
    tools.present[:] = False
    for _ in range(1000):
        simulation.step(tools)
    start = simulation.catheter.state.position_m[:, 0].mean()
    for _ in range(400):
        simulation.step(tools)
    crept_m = abs(simulation.catheter.state.position_m[:, 0].mean() - start)
    assert crept_m * 60.0 / 0.4 < 1e-7


def test_a_force_sinks_as_deep_in_short_steps_as_in_long_ones():
    """Before, by as much in every part of a step: jaws that drag a catheter over the rim sank 140 um deep into it."""
    play = KINDS["dragged over the rim"](Draw(Reach.LONG, 20261207).random("abuse dragged over the rim, number 9"))
    simulation, tools = Simulation(play.scene, reduced_duct(play.scene)), ToolInputs()
    judge, largest_n = OverlapJudge(simulation), 0.0
    for tick in range(LEAD_STEPS + 150):
        play.hands.write(tick, tools)
        simulation.step(tools)
        largest_n = max(largest_n, float(simulation.contacts.force_n[: simulation.contacts.n_contacts, 0].max()))
        if tick > LEAD_STEPS:
            judge.look()
    assert largest_n > 1.0
    assert judge.deepest["tool in catheter"] < CREEP_M_S_N / (1e3 * play.scene.contact.recovery) * largest_n + CLEAR_M
