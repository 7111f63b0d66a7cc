"""The friction of an introducer: it holds without creeping and breaks away at its limit, at any speed and step."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

from tests.by_day import by_day
from trocar.services.mechanics.bodies.catheter import BEARING_DIAMETERS
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.contact.laws import SEAL_SOFTNESS_M_N, number_of
from trocar.services.mechanics.contact.seal import slide_seal
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation

SEAL_N = 20e-3
PARTICLE = 15  # held by a grasp that never slips, 15 mm before the exit


def in_introducer(with_effects, small_duct, effects=None, **catheter):
    """A catheter that points at the duct from 20 mm away."""
    settings = {
        "introducer_seal_friction_n": SEAL_N,
        "viscous_drag_n_s_m2": 0.0,
        "tip_position_m": (60e-3, 0.0, 0.0),
        **catheter,
    }
    scene = with_effects(**effects or {})
    return Simulation(replace(scene, catheter=replace(scene.catheter, **settings)), small_duct)


class Pull:
    """One point of the catheter held by a hand that moves along the introducer."""

    def __init__(self, simulation, dt_s):
        self.simulation, self.tools, self.dt_s = simulation, ToolInputs(), dt_s
        self.tools.present[0] = False
        self.at = simulation.catheter.state.position_m[PARTICLE] + np.array([0.0, 0.0, 8e-3])
        self.tools.holds = [GraspHold(1, 1, CATHETER_SEGMENT, PARTICLE, np.array([1.0, 0.0, 0.0]), 10.0, 0.3)]

    def to(self, way_m):
        """Take a step and return what hand and seal pull with."""
        self.tools.position_m[1] = self.at - np.array([way_m, 0.0, 0.0])
        self.simulation.step(self.tools, dt_s=self.dt_s)
        rows, n = self.simulation.contacts, self.simulation.contacts.n_contacts
        along = self.simulation.contact_force_n[:, 0]
        return tuple(along[rows.law[:n] == number_of(law)].sum() for law in ("grip", "seal"))


@pytest.mark.parametrize(
    ("speed_m_s", "dt_s"),
    by_day(
        [(1e-3, 1e-3), (1e-2, 2.5e-4), (5e-2, 2.5e-4)],
        [(1e-3, 2.5e-4), (1e-2, 1e-3), (5e-2, 1e-3)],
    ),
)
def test_breaking_away_takes_the_friction_of_the_seal_at_any_speed_and_step(with_effects, small_duct, speed_m_s, dt_s):
    simulation = in_introducer(with_effects, small_duct)
    pull, way_m = Pull(simulation, dt_s), 0.2e-3 + 10e-3 * speed_m_s
    n = round(way_m / speed_m_s / dt_s)
    seal_n = np.array([pull.to(way_m * tick / n)[1] for tick in range(n + 1)])
    assert np.abs(seal_n).max() == pytest.approx(SEAL_N, rel=1e-9)
    assert np.abs(seal_n[-n // 4 :]).mean() == pytest.approx(SEAL_N, rel=0.01)


@pytest.mark.parametrize("dt_s", by_day([1e-3], [2.5e-4]))
def test_the_hand_feels_no_more_than_the_friction_of_the_seal(with_effects, small_duct, dt_s):
    """So slowly that the mass of the catheter does not count; and what the seal takes is its force times the way."""
    simulation = in_introducer(with_effects, small_duct)
    pull, way_m = Pull(simulation, dt_s), 0.2e-3
    n = round(way_m / 1e-3 / dt_s)
    hand_n = np.array([pull.to(way_m * tick / n)[0] for tick in range(n + 1)])
    assert np.abs(hand_n).max() == pytest.approx(SEAL_N, rel=0.01)
    # The hand's spring and the seal's own elasticity come first: 40 and 2 um.
    slid_m = way_m - SEAL_N * (1.0 / simulation.scene.forceps[1].coupling_stiffness_n_m + 1e-4)
    assert simulation.seal.memory.dissipated_j == pytest.approx(SEAL_N * slid_m, rel=0.03)


@pytest.mark.parametrize("dt_s", by_day([1e-3, 1e-4], [2.5e-4]))
def test_a_seal_and_the_grip_that_pulls_at_it_hold_without_creeping(with_effects, small_duct, dt_s):
    """Drawn taut within its friction in thick oil, then watched at each step: not a thousandth is lost in a minute."""
    simulation = in_introducer(with_effects, small_duct, viscous_drag_n_s_m2=5.0)
    pull, way_m = Pull(simulation, 1e-3), 40e-6
    for tick in range(400):
        pull.to(way_m * min(tick / 200, 1.0))
    pull.dt_s = dt_s
    for _ in range(300):
        start_n = np.array(pull.to(way_m))
    assert np.all(np.abs(start_n) > 0.7 * SEAL_N)
    assert np.all(np.abs(start_n) < 0.95 * SEAL_N)
    for _ in range(300):
        end_n = np.array(pull.to(way_m))
    assert np.all(np.abs(end_n - start_n) * 60.0 / (300 * dt_s) < 1e-3 * SEAL_N)


@pytest.mark.parametrize("dt_s", [1e-3, 2.5e-4])
@pytest.mark.parametrize("share", [0.9, 1.2])
def test_a_weight_beyond_the_friction_of_the_seal_falls_with_what_is_left_of_it(with_effects, small_duct, share, dt_s):
    mass_kg = in_introducer(with_effects, small_duct).catheter.properties.particle_mass_kg().sum()
    gravity = {"acceleration_m_s2": (-share * SEAL_N / mass_kg, 0.0, 0.0)}
    simulation = in_introducer(with_effects, small_duct, {"gravity": gravity})
    tools, n = ToolInputs(), round(0.02 / dt_s)
    tools.present[:] = False
    for _ in range(n):
        simulation.step(tools, dt_s=dt_s)
    momentum = -simulation.catheter.properties.particle_mass_kg() @ simulation.catheter.state.velocity_m_s[:, 0]
    assert momentum == pytest.approx(max(share - 1.0, 0.0) * SEAL_N * 0.02, abs=0.02 * SEAL_N * 0.02)


def test_the_wall_of_the_introducer_holds_mu_times_its_pushes(with_effects, small_duct):
    """Its weight hangs on the catheter at the exit, up and down; pulling it on takes mu times what both come to."""
    mu = 0.2
    simulation = in_introducer(
        with_effects,
        small_duct,
        {"gravity": {"acceleration_m_s2": (0.0, 0.0, -9.81)}},
        introducer_seal_friction_n=0.0,
        introducer_friction=mu,
        viscous_drag_n_s_m2=0.05,
    )
    pull = Pull(simulation, 1e-3)
    model = simulation.catheter.integrator.model
    entry, length_m = model.introducer.entry, model.introducer.length
    bearing_m = BEARING_DIAMETERS * simulation.scene.catheter.outer_diameter_m
    ratio = []
    for tick in range(600):
        before = simulation.catheter.state.position_m.copy()
        held_n = pull.to(max(tick - 300, 0) * 1e-5)[1]
        if tick > 500:
            ratio.append(abs(held_n) / wall_pushes(before, entry, length_m, model.rest_length[0], 1e5, bearing_m))
    # The kernel samples a span at four places.
    assert np.array(ratio) == pytest.approx(mu, rel=0.02)


def wall_pushes(position, entry, length_m, segment_m, stiffness_n_m, bearing_m):
    """Integral of the wall's push on a rod that goes along -x, from how far it stands off the axis.

    Each push spread along the axis by a quadratic B-spline, those that overlap added as vectors.
    """
    x, across = entry[0] - position[:, 0], position[:, 1:] - entry[1:]
    inside = (x > 0.0) & (x < length_m)
    depth = np.minimum(np.minimum(x, length_m - x)[inside] / segment_m, 1.0)
    pushes = [*zip(x[inside], ((depth * (2.0 - depth)) ** 2)[:, None] * across[inside], strict=True)]
    for plane in (0.0, length_m):
        j = np.searchsorted(x, plane) - 1
        end = np.array([entry[0] - plane, *entry[1:]])
        pushes.append((plane, min((offset(position[k - 1 : k + 2], end) for k in (j, j + 1)), key=np.linalg.norm)[1:]))
    span = bearing_m / 3.0
    bell = BSpline.basis_element(span * np.array([-1.5, -0.5, 0.5, 1.5]), extrapolate=False)
    at, step = np.linspace(-bearing_m, length_m + bearing_m, 5001, retstep=True)
    density = sum(np.outer(np.nan_to_num(bell(at - axial)), push) for axial, push in pushes)
    return stiffness_n_m * np.linalg.norm(density, axis=1).sum() * step / span


def offset(span, p):
    """From p to the parabola between the middles of the two segments of ``span`` (3, 3), tangent to both."""
    a, b, c = span
    start, end = 0.5 * (a + b), 0.5 * (b + c)

    def off(u):
        return (1.0 - u) ** 2 * start + 2.0 * u * (1.0 - u) * b + u * u * end - p

    options = {"xatol": 1e-12}
    return off(
        minimize_scalar(lambda u: np.linalg.norm(off(u)), bounds=(0.0, 1.0), method="bounded", options=options).x
    )


def test_a_catheter_that_hangs_in_its_seal_sleeps_and_is_held_when_it_wakes(with_effects, small_duct):
    """Drawn by its weight within the seal's friction; asleep it needs no row, awake again it is where it was."""
    mass_kg = in_introducer(with_effects, small_duct).catheter.properties.particle_mass_kg().sum()
    gravity = {"gravity": {"acceleration_m_s2": (-0.8 * SEAL_N / mass_kg, 0.0, 0.0)}}
    simulation = in_introducer(with_effects, small_duct, gravity, viscous_drag_n_s_m2=2.0)
    tools = ToolInputs()
    tools.present[:] = False
    for _ in range(600):
        simulation.step(tools)
    assert simulation.catheter.slept
    assert len(simulation.seal.rows) == 0
    hung_m = simulation.catheter.state.position_m.copy()
    # A push that nobody feels wakes it.
    simulation.catheter.state.velocity_m_s[-1, 2] = 1e-6
    simulation.step(tools)
    assert not simulation.catheter.slept
    assert abs(simulation.contacts.force_n[0, 0]) == pytest.approx(0.8 * SEAL_N, rel=1e-3)
    for _ in range(20):
        simulation.step(tools)
    assert np.abs(simulation.catheter.state.position_m - hung_m).max() < 1e-8


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_the_lip_stretches_no_further_than_its_friction_bears_wherever_a_solve_ended(with_effects, small_duct, share):
    """A solve that was cut short leaves the catheter at 0.3 mm from where the seal holds it: it has slid."""
    simulation = in_introducer(with_effects, small_duct)
    Pull(simulation, 1e-3).to(0.0)
    system, memory = simulation.system, simulation.seal.memory
    row, force_n, moved_m = memory.row, 0.5 * SEAL_N, -0.3e-3
    memory.start_m = memory.dissipated_j = 0.0
    system.rows.force_n[row, 0], system.slides[row] = force_n, False
    system.motion_m[3 * row] = moved_m
    slide_seal(system.address, memory.address, True, share)
    limit_n = system.rows.force_limit_n[row]
    assert memory.elastic_m == pytest.approx(-share * SEAL_SOFTNESS_M_N * limit_n)
    slid_m = abs(moved_m) + SEAL_SOFTNESS_M_N * force_n - SEAL_SOFTNESS_M_N * limit_n
    assert memory.dissipated_j == pytest.approx(share * force_n * slid_m)
