"""A catheter over a rigid cylinder: the ratio of tensions at which it slips is exp(mu theta)."""

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.bodies.catheter import list_particles
from trocar.services.mechanics.compiled.vectors import write_frame
from trocar.services.mechanics.contact.delassus import add_rod_compliance, rotate_to_contact_frames
from trocar.services.mechanics.contact.free_motion import free_motion
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.solver import solve_contacts
from trocar.services.mechanics.contact.stages import write_results
from trocar.services.mechanics.contact.writer import append_row
from trocar.services.mechanics.rod import ImplicitIntegrator, RodProperties, rod_along

RADIUS = 20e-3
N_SEGMENTS = 80


def wrapped_rod(angle):
    """Laid over the top of the cylinder, straight ends hanging along the tangents."""
    properties = RodProperties(
        N_SEGMENTS,
        0.16,
        0.5e-3,
        axial_stiffness_n=200.0,
        bending_stiffness_n_m2=1e-9,
        linear_density_kg_m=2e-3,
        internal_damping_s=1e-3,
        viscous_drag_n_s_m2=0.4,
    )
    s = np.linspace(-0.0801, 0.0801, 2001)
    half = 0.5 * angle * RADIUS
    phi = np.clip(s, -half, half) / RADIUS
    curve = RADIUS * np.stack([np.sin(phi), np.zeros_like(phi), np.cos(phi)], axis=1)
    beyond = (s - np.clip(s, -half, half))[:, None]
    curve += beyond * np.stack([np.cos(phi), np.zeros_like(phi), -np.sin(phi)], axis=1)
    return properties, rod_along(properties, curve)


def contact_rows(start, motion, mu):
    rows = ContactRows.zeros(c=N_SEGMENTS + 1)
    for i, p in enumerate(start):
        distance = np.hypot(p[0], p[2])
        if distance > RADIUS + 0.5e-3:
            continue
        k = append_row(rows, number_of("unilateral"), i)
        write_frame(np.array([p[0], 0.0, p[2]]) / distance, rows.frame[k])
        rows.gap_m[k] = distance - RADIUS
        rows.slip_m[k] = motion[i]
        rows.rod_node[k, 0], rows.rod_weight[k, 0] = i, 1.0
        rows.friction[k] = mu
    return rows


def slip_ratio(mu, angle):
    """Pull one end harder and harder; return the ratio of tensions when the rod has run by 0.1 mm.

    Elastic stretch moves the middle by a hundredth of a millimetre before that.
    """
    properties, state = wrapped_rod(angle)
    rod = ImplicitIntegrator(properties)
    hold = 0.05
    down = np.array([[side * np.cos(0.5 * angle), 0.0, -np.sin(0.5 * angle)] for side in (-1, 1)])
    force, contact = np.zeros_like(state.position_m), np.zeros_like(state.position_m)
    start_mean = None
    pull = hold
    for tick in range(4000):
        if tick > 300:
            pull *= 1.0 + 3e-4
        force[:] = 0.0
        force[0], force[-1] = hold * down[0], pull * down[1]
        before = state.position_m.copy()
        rod.predict(state, force + contact, 1e-3)
        rod.correct(state, -contact)
        rows = contact_rows(before, state.position_m - before, mu)
        contact[:] = solve(rows, rod, properties.n_particles)
        rod.correct(state, contact)
        if tick == 300:
            start_mean = state.position_m[N_SEGMENTS // 2, 0]
        if tick > 300 and state.position_m[N_SEGMENTS // 2, 0] - start_mean > 0.1e-3:
            break
    return pull / hold


def solve(rows, rod, n):
    slot, particles = np.zeros(n, np.int32), np.zeros(n, np.int32)
    k = rows.n_contacts
    count = list_particles(rows.rod_node[:k], rows.rod_weight[:k], slot, particles)
    compliance, W = np.zeros((3 * count, 3 * count)), np.zeros((3 * k, 3 * k))
    rod.compliance(particles[:count], compliance)
    add_rod_compliance(rows, slot, compliance, np.zeros((4 * rows.capacity, 2), np.int32), W, 0)
    rotate_to_contact_frames(rows, W, 0)
    problem = ContactProblem.of(rows)
    free_motion(rows, 0.2, 1e-3, problem.free)
    solve_contacts(problem, W, (60, 1e-8))
    world, out = np.zeros((k, 3)), np.zeros((n, 3))
    write_results(rows, np.zeros(k, np.bool_), world)
    out[rows.rod_node[:k, 0]] = world
    return out


@pytest.mark.parametrize(("mu", "degrees", "ratio"), by_day([(0.1, 180, 1.369)], [(0.3, 90, 1.602), (0.3, 180, 2.566)]))
def test_capstan_ratio(mu, degrees, ratio):
    assert slip_ratio(mu, np.radians(degrees)) == pytest.approx(ratio, rel=0.03)
