"""What the contact solve promises of the end of the step is what the bodies do."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.contact.free_motion import effective_gap
from trocar.services.mechanics.contact.lasting_compliance import LASTING_S
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation


@pytest.fixture
def pressed(with_effects, small_duct):
    """Tool 0 presses the duct from above, tool 1 holds the catheter; gravity lays it on the wall."""
    scene = with_effects(friction={}, gravity={}, grasp_slip={})
    simulation = Simulation(scene, small_duct)
    tools = ToolInputs()
    hold_point = simulation.catheter.state.position_m[10].copy()
    tools.holds = [
        GraspHold(1, 1, 1, 10, np.array([1.0, 0.0, 0.0]), 2.0, 0.3),
        GraspHold(2, 1, 1, 10, np.array([0.5, 0.5, 0.0]), 2.0, 0.3),
    ]
    for k in range(150):
        tools.position_m[0] = 20e-3, 0.0, 15e-3 + 5.5e-3 - min(k, 60) * 4e-5
        tools.position_m[1] = hold_point + np.array([-k * 2e-5, 0.0, 8e-3])
        simulation.step(tools)
    return simulation, tools


def duct_state(simulation):
    """Modes and contact loads as they are now."""
    duct, n = simulation.duct, simulation.duct.n_loads
    return duct.state.q.copy(), duct.load_nodes[:n].copy(), duct.load_force_n[:n].copy()


def duct_points(simulation, state, rows, n):
    """Where the contact points on the wall are in a state of the duct."""
    duct, (q, nodes, loads) = simulation.duct.reduced, state
    field = duct.basis.displacements(q)
    duct.residual.apply(nodes, loads, np.arange(duct.basis.n_nodes, dtype=np.int32), field)
    return np.einsum("kc,kci->ki", rows.duct_weight[:n], (duct.mesh.vertices_m + field)[rows.duct_node[:n]])


def test_motion_of_the_bodies_is_the_motion_that_was_solved_for(pressed):
    simulation, tools = pressed
    body, before = simulation.tools, duct_state(simulation)
    tools.position_m[0, 2] -= 3e-5
    simulation.step(tools)
    start_tools, start_rod = body.free - body.motion, simulation.catheter.start_m
    rows, n, holds = simulation.contacts, simulation.contacts.n_contacts, simulation.holds.rows
    wall = duct_points(simulation, duct_state(simulation), rows, n) - duct_points(simulation, before, rows, n)
    rod = simulation.catheter.state.position_m - start_rod
    # The duct's part of W is kept in single precision: half a bit of all that the forces move.
    size = np.abs(simulation.system.compliance_m_n) @ np.abs(rows.force_n[:n]).ravel()
    rounding_m = 2.0**-24 * size.max()
    print(f"motions up to {size.max():.1e} m are rounded by {rounding_m:.1e} m")
    for row in range(n):
        solved = simulation.system.motion_m[3 * row : 3 * row + 3].copy()
        solved -= rows.softness_m_n[row] * rows.force_n[row]
        moved = rows.rod_weight[row] @ rod[rows.rod_node[row]] - wall[row]
        if rows.tool[row] >= 0:
            moved = moved + rows.lever[row] @ (body.proxy - start_tools)[rows.tool[row]]
        if row in holds:
            moved = moved + rows.point_m[row] + rows.rod_weight[row] @ start_rod[rows.rod_node[row]]
        expected = rows.frame[row] @ moved
        expected[1:] += (rows.frame[row] @ rows.elastic_m[row])[1:]
        if row not in holds:
            expected[0] += effective_gap(rows, row, simulation.system.settings.recovery, 1e-3)
        assert np.allclose(expected, solved, atol=1e-12 + rounding_m)
    others = [row for row in range(n) if row not in holds]
    assert len(holds) > 0
    assert (rows.tool[others] >= 0).any()
    assert (rows.tool[others] < 0).any()
    assert (rows.force_n[others, 0] > 0.0).any()
    assert np.abs(wall).max() > 1e-6


def test_every_force_has_its_reaction(pressed):
    simulation, tools = pressed
    total_force = 0.0
    for _ in range(30):
        simulation.step(tools)
        on_duct = simulation.duct.load_force_n[: simulation.duct.n_loads].sum(axis=0)
        on_rod = simulation.catheter.contact_force_n.sum(axis=0)
        rows, forces = simulation.contacts, simulation.contact_force_n
        on_tools = forces[rows.tool[: rows.n_contacts] >= 0].sum(axis=0)
        total_force += np.abs(on_duct).sum()
        assert np.abs(on_duct + on_rod + on_tools).max() < 1e-12
    assert total_force > 0.1


def test_port_carries_what_the_hand_at_the_junction_does_not(pressed):
    simulation, tools = pressed
    simulation.step(tools)
    results, body = simulation.tool_results, simulation.tools
    rows, forces = simulation.contacts, simulation.contact_force_n
    for tool in range(2):
        mine = rows.tool[: rows.n_contacts] == tool
        moment = np.cross(rows.point_m[: rows.n_contacts][mine] - body.port_m[tool], forces[mine]).sum(axis=0)
        assert np.allclose(moment, results.port_moment_nm[tool], atol=1e-14)


def test_local_stiffness_predicts_the_change_of_force(with_effects, small_duct):
    """Through couplings without dampers, a hand that moves evenly by dx for 5 ms feels -K dx more, nearly."""
    scene = with_effects(friction={}, gravity={})
    left, right = (replace(each, coupling_damping_n_s_m=0.0, jaw_damping_nm_s_rad=0.0) for each in scene.forceps)
    simulation, tools = Simulation(replace(scene, forceps=(left, right)), small_duct), ToolInputs()
    tools.present[1] = False
    for k in range(500):
        tools.position_m[0] = 20e-3, 0.0, 15e-3 + 5.5e-3 - min(k, 60) * 4e-5
        simulation.step(tools)
    results, ticks = simulation.tool_results, round(LASTING_S / 1e-3)
    for axis in range(3):
        force, K = results.force_n[0].copy(), results.stiffness_n_m[0].copy()
        assert np.allclose(K, K.T)
        dx = 2e-6 * np.eye(3)[axis]
        for _ in range(ticks):
            tools.position_m[0] += dx / ticks
            simulation.step(tools)
        expected = -K @ dx
        assert np.linalg.norm(expected) > 5e-5
        assert results.force_n[0] - force == pytest.approx(expected, abs=0.25 * np.linalg.norm(expected))
        for _ in range(200):
            simulation.step(tools)


def test_same_inputs_give_the_same_bits(with_effects, small_duct):
    ends = []
    for _ in range(2):
        simulation = Simulation(with_effects(friction={}, gravity={}), small_duct)
        tools = ToolInputs()
        for k in range(80):
            tools.position_m[0] = 20e-3, 0.0, 15e-3 + 5.5e-3 - k * 3e-5
            tools.position_m[1] = 30e-3, 0.0, 40e-3
            simulation.step(tools)
        ends.append(np.concatenate([simulation.duct.state.q, simulation.catheter.state.position_m.ravel()]))
    assert np.array_equal(*ends)


@pytest.mark.parametrize("pull_m", [2e-3, -2e-3])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_held_point_of_the_wall_comes_along_to_where_the_jaws_are(small_scene, small_duct, axis, pull_m):
    """To what the grip gives way: its row has no gap, though its wall has moved. Where jaws close it only guides."""
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    triangle = 200
    rest = small_duct.mesh.vertices_m[small_duct.mesh.triangles[triangle]].mean(axis=0)
    tools.position_m[0], tools.present[1] = np.add(rest, (0.0, 0.0, 8e-3)), False
    tools.holds = [GraspHold(1, 0, 0, triangle, np.full(3, 1.0 / 3.0), 2.0, 0.3)]
    start = tools.position_m[0].copy()
    for k in range(300):
        tools.position_m[0, axis] = start[axis] + pull_m * min(k, 200) / 200
        simulation.step(tools)
    (row,) = simulation.holds.rows
    simulation.step(tools)
    force = simulation.contact_force_n[row]
    held = duct_points(simulation, duct_state(simulation), simulation.contacts, row + 1)[row]
    in_jaws = simulation.contacts.point_m[row]
    frame = simulation.contacts.frame[row]
    is_guided = abs(frame[0, axis]) > 0.9
    assert np.linalg.norm(force) > (1e-3 if is_guided else 5e-3)
    gives_way = simulation.contacts.softness_m_n[row] * (frame @ force)
    np.testing.assert_allclose(frame @ (in_jaws - held), -gives_way, atol=2e-6)
