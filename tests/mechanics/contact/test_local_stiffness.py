"""The stiffness between hand and world, against one dense step of backward Euler of everything that a tool touches."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.contact import admissible
from trocar.services.mechanics.contact.lasting_compliance import LASTING_S
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.rod.generalized_alpha import implicit_euler
from trocar.services.mechanics.rod.implicit_kernels import assemble_again, remove_held
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation

TOOL = 1
EFFECTS = {"friction": FrictionSettings(), "grasp_slip": NoSettings()}


def press(simulation, tools, tick):
    """Lower the shut jaws into the wall."""
    tools.position_m[TOOL] = 20e-3, 0.0, 23e-3 - 6.5e-3 * min(1.0, tick / 80)
    tools.jaw_angle_rad[TOOL] = 0.1


def pinch(simulation, tools, tick):
    """Close the jaws round the wall."""
    tools.position_m[TOOL] = 33e-3, 0.0, 12e-3 + 6e-3 * max(1.0 - tick / 30, 0.0)
    tools.roll_rad[TOOL] = 0.5 * np.pi
    tools.jaw_angle_rad[TOOL] = 1.2 - 1.2 * min(1.0, max(tick - 30, 0) / 80)


def hold(simulation, tools, tick):
    """Hold the catheter, and squeeze it."""
    if tick == 0:
        tools.position_m[TOOL] = simulation.catheter.state.position_m[15] + np.array([0.0, 0.0, 11e-3])
        tools.roll_rad[TOOL] = 0.5 * np.pi
        tools.holds = [GraspHold(3, TOOL, CATHETER_SEGMENT, 15, np.array([1.0, 0.0, 0.0]), 0.05, 0.26)]
    tools.jaw_angle_rad[TOOL] = 0.26 - 0.1 * min(1.0, tick / 60)


def lean(simulation, tools, tick):
    """Push the catheter aside with shut jaws."""
    if tick == 0:
        lean.place = simulation.catheter.state.position_m[12] + np.array([0.0, 0.0, 19e-3])
    tools.position_m[TOOL] = lean.place - np.array([0.0, 0.0, 6e-3 * min(1.0, tick / 80)])
    tools.jaw_angle_rad[TOOL] = 0.1


@pytest.mark.parametrize("hands", [press, pinch, hold, lean], ids=lambda hands: hands.__name__)
def test_it_is_that_of_a_dense_step_of_backward_euler(small_scene, small_duct, hands):
    simulation, tools = Simulation(replace(small_scene, effects=EFFECTS), small_duct), ToolInputs()
    tools.present[0] = False
    for tick in range(130):
        hands(simulation, tools, tick)
        simulation.step(tools)
    assert closed_axes(simulation), "the tool touches nothing"
    expected = dense_stiffness(simulation)
    scale = np.abs(expected).max()
    results = simulation.tool_results
    np.testing.assert_allclose(results.stiffness_n_m[TOOL], expected[:3, :3], atol=1e-6 * scale, rtol=1e-6)
    assert results.grasp_stiffness_nm_rad[TOOL] == pytest.approx(expected[3, 3], rel=1e-6, abs=1e-9)


def closed_axes(simulation):
    """Return row and axis of what stays closed when the hand moves."""
    rows, slides = simulation.contacts, simulation.system.slides
    return [
        (row, axis)
        for row in range(rows.n_contacts)
        if rows.tool[row] == TOOL
        for axis in range(admissible.closed_axes(rows, row, slides[row]))
    ]


def dense_stiffness(simulation):
    r"""Return what a hand meets (4, 4) that moves its coordinates, and the world with it, over `LASTING_S`.

    The stationary point of :math:`\frac12 z^T A z + \frac12 (p - h)^T K (p - h) + \lambda^T (J z + G p) - \frac12
    \lambda^T C \lambda`, over modes and particles z, the tool p and the forces: the tool follows the hand h by its
    spring alone. C is what gives way at once: the touching surfaces, and the modes that were left out.
    """
    axes = closed_axes(simulation)
    A, J = world(simulation, axes)
    rows, arrays = simulation.contacts, simulation.tools
    G = np.array([rows.frame[row, axis] @ rows.lever[row] for row, axis in axes])
    K = np.diag(arrays.stiffness[TOOL])
    n, m = len(A), len(axes)
    system = np.zeros((n + 4 + m, n + 4 + m))
    system[:n, :n], system[n : n + 4, n : n + 4] = A, K
    system[n + 4 :, :n], system[n + 4 :, n : n + 4] = J, G
    system[:n, n + 4 :], system[n : n + 4, n + 4 :] = J.T, G.T
    system[n + 4 :, n + 4 :] = -at_once(simulation, axes)
    right = np.zeros((n + 4 + m, 4))
    right[n : n + 4] = K
    p = np.linalg.solve(system, right)[n : n + 4]
    return K @ (np.eye(4) - p)


def world(simulation, axes):
    """Return the matrix of modes and free particles over one step (k, k), and how they move the axes (m, k)."""
    rows, reduced, t = simulation.contacts, simulation.duct.reduced, LASTING_S
    w, zeta, Phi = reduced.basis.omega_rad_s, reduced.damping_ratio, reduced.basis.Phi
    rod, is_free = rod_matrix(simulation.catheter.plain_integrator)
    modes = (1.0 + 2.0 * zeta * w * t + (w * t) ** 2) / t**2
    A = np.zeros((len(w) + len(rod),) * 2)
    A[: len(w), : len(w)], A[len(w) :, len(w) :] = np.diag(modes), rod / t**2
    J = np.zeros((len(axes), len(A)))
    for k, (row, axis) in enumerate(axes):
        direction = rows.frame[row, axis]
        for node, weight in zip(rows.duct_node[row], rows.duct_weight[row], strict=True):
            J[k, : len(w)] -= weight * direction @ Phi[node]
        of_rod = np.zeros((len(is_free) // 3, 3))
        for particle, weight in zip(rows.rod_node[row], rows.rod_weight[row], strict=True):
            of_rod[particle] += weight * direction
        J[k, len(w) :] = of_rod.ravel()[is_free]
    return A, J


def rod_matrix(rod):
    """Return M + t C + t^2 K between the free coordinates of the catheter, and which those are."""
    assemble_again(rod.model, rod.work, implicit_euler(LASTING_S))
    remove_held(rod.model, rod.work)
    n = 3 * len(rod.model.mass)
    lower = np.zeros((n, n))
    for j in range(n):
        for a in range(min(rod.work.band.shape[1], n - j)):
            lower[j + a, j] = rod.work.band[j, a]
    is_free = ~np.repeat(rod.model.is_held, 3)
    full = lower + np.tril(lower, -1).T
    return full[np.ix_(is_free, is_free)], is_free


def at_once(simulation, axes):
    """Return what surfaces and the modes that were left out give way between the axes (m, m)."""
    rows, reduced = simulation.contacts, simulation.duct.reduced
    C = np.diag([rows.softness_m_n[row, axis] for row, axis in axes])
    for j, (loaded, along) in enumerate(axes):
        force = rows.duct_weight[loaded][:, None] * rows.frame[loaded, along]
        for i, (row, axis) in enumerate(axes):
            moved = np.zeros((3, 3))
            reduced.residual.apply(rows.duct_node[loaded], force, rows.duct_node[row], moved)
            C[i, j] += rows.duct_weight[row] @ moved @ rows.frame[row, axis]
    return C
