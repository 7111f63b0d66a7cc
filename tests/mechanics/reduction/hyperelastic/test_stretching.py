"""A wall that stiffens: closed forms of Fung's membrane, the samples that stand for the wall, and its step."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import fsolve, minimize

from trocar.services.mechanics.fem import ShellModel, ShellSection, clamp, pressure_load
from trocar.services.mechanics.reduction import ExactOscillator, ModalBasis, ModalState, Newmark
from trocar.services.mechanics.reduction.build import build_basis
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import (
    StretchSamples,
    choose_samples,
    every_triangle,
    sparse_weights,
)
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.membrane_laws.fung import MOST_Q
from trocar.services.mechanics.reduction.wall_step.energy_tank import settle_step
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    ENERGY,
    POINTS,
    TANK,
    WallStep,
    held_force,
    wall_energy,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS, LENGTH, THICKNESS, E, NU, EXPONENT = 4e-3, 40e-3, 0.5e-3, 100e3, 0.45, 20.0
LAW = BeyondLinear.of("fung", exponent=EXPONENT)


def model_of(n_around, n_along):
    mesh = parametric_duct(DuctGeometry(radius_m=RADIUS, length_m=LENGTH, n_around=n_around, n_along=n_along))
    return ShellModel(mesh, ShellSection(THICKNESS, E, NU, 1060.0), [clamp(mesh)])


@pytest.fixture(scope="module")
def model():
    return model_of(16, 20)


@pytest.fixture(scope="module")
def tube():
    """Even inflation and even stretch along the axis, as the modes of a tube that nothing holds; its samples."""
    model = model_of(48, 12)
    x = model.mesh.vertices_m
    shapes = np.stack([x * [0.0, 1.0, 1.0], x * [1.0, 0.0, 0.0]], axis=2)
    basis = modes_of(model, shapes)
    return model.mesh, basis, choose_samples(model, basis, LAW)


@pytest.fixture(scope="module")
def duct(model):
    return build_basis(model, 40)


@pytest.fixture(scope="module")
def samples(model, duct):
    return choose_samples(model, duct, LAW)


def modes_of(model, shapes):
    """Modes within the span of shapes of a membrane, from its own strains."""
    every = every_triangle(model, ModalBasis.from_modes(np.ones(shapes.shape[2]), shapes), LAW)
    stiffness = every.strain.T @ (np.repeat(every.energy_j, 3)[:, None] * every.strain)
    squared, turn = eigh(stiffness, np.einsum("nir,n,nis->rs", shapes, model.mass_kg, shapes))
    return ModalBasis.from_modes(np.sqrt(squared), shapes @ turn)


def stress(strain):
    """Fung's stress (2,) along and round, in Pa, of strains along and round."""
    D = E / (1.0 - NU**2) * np.array([[1.0, NU], [NU, 1.0]])
    Q = EXPONENT / E * strain @ D @ strain
    assert Q < MOST_Q
    return D @ strain * np.exp(Q)


class Stepped:
    """Modes with the stiffening, stepped as in a simulation."""

    def __init__(self, basis, samples, damping=0.0, dt_s=1e-3, kind=Newmark):
        self.dt_s, r, self.basis, self.free_m = dt_s, basis.n_modes, basis, np.inf
        self.state, self.omega = ModalState.at_rest(r), basis.omega_rad_s
        self.integrator = kind(basis.omega_rad_s, np.full(r, damping))
        self.damping = 2.0 * basis.omega_rad_s * damping
        kicked, held = (
            ModalState(np.zeros(r), rate, acceleration)
            for rate, acceleration in ((np.ones(r), -self.damping), (np.zeros(r), np.ones(r)))
        )
        self.integrator.predict(kicked, np.zeros(r), dt_s)
        self.integrator.predict(held, np.ones(r), dt_s)
        self.position_gain, self.gains = dt_s * kicked.q, [held.q, held.qdot, held.qddot]
        self.held_gain = self.gains[0]
        self.wall, self.force, self.contact_impulse = WallStep.of(self.omega**2, samples), np.zeros(r), np.zeros(r)
        self.wall.take_gain(self.held_gain)

    def step(self, load, expected=0.0, blow=0.0):
        """Step under a load, with a force that expects a contact but no ``blow`` (r,) of the rates."""
        ahead, state, force = self.state.copy(), self.state, np.zeros(load.size)
        ahead.qddot -= self.force
        self.integrator.predict(ahead, load, self.dt_s)
        held_force(self.wall.address, state.q, ahead.q + self.position_gain * expected, force)
        self.q_start = state.q.copy()
        state.qddot += force - self.force - self.damping * blow
        state.qdot += blow
        self.force[:] = force
        self.integrator.predict(state, load + force, self.dt_s)
        settle_step(self.wall, self.force, self, lambda: self.free_m)

    def furthest_m(self, change):
        return float(np.linalg.norm(self.basis.displacements(change), axis=1).max())

    def change_held(self, held, change):
        for end, gain in zip((self.state.q, self.state.qdot, self.state.qddot), self.gains, strict=True):
            end += gain * change
        held += change

    def remove_energy(self, energy_j):
        kinetic_j = self.state.kinetic_energy_j()
        paid_j = min(energy_j, kinetic_j)
        self.state.qdot *= np.sqrt(1.0 - paid_j / kinetic_j) if kinetic_j > 0.0 else 0.0
        return paid_j

    def energy_j(self):
        stored = self.state.strain_energy_j(self.omega) + wall_energy(self.wall.address, self.state.q)
        return self.state.kinetic_energy_j() + stored


@pytest.mark.parametrize("pressure_pa", [10.0, 1e3, 3e3, 6e3])
@pytest.mark.parametrize("pull_n_m", [0.0, 10.0])
def test_a_tube_under_pressure_and_pull_rests_where_the_closed_form_says(tube, pressure_pa, pull_n_m):
    """Pressure p R and a pull along the axis, both per length of wall, against Fung's stress times thickness."""
    mesh, basis, samples = tube
    load = pressure_pa * pressure_load(mesh, 1.0)
    ends = mesh.vertices_m[:, 0] > LENGTH - 1e-9, mesh.vertices_m[:, 0] < 1e-9
    for end, sign in zip(ends, (1.0, -1.0), strict=True):
        load[end, 0] += sign * pull_n_m * 2.0 * np.pi * RADIUS / end.sum()
    wanted_pa = np.array([pull_n_m, pressure_pa * RADIUS]) / THICKNESS
    closed = fsolve(lambda e: stress(e) - wanted_pa, wanted_pa / E / 3.0, xtol=1e-12)
    stepped = Stepped(basis, samples, damping=0.7)
    modal = np.einsum("nar,na->r", basis.Phi, load)
    for _ in range(300):
        stepped.step(modal)
    moved = basis.displacements(stepped.state.q)
    round_it = np.mean(np.linalg.norm((mesh.vertices_m + moved)[:, 1:], axis=1)) / RADIUS - 1.0
    along = (moved[ends[0], 0].mean() - moved[ends[1], 0].mean()) / LENGTH
    # On a polygon of 48 corners a pressure pulls by 1 - cos(pi / 48) = 0.2 % less.
    assert np.array([along, round_it]) == pytest.approx(closed, abs=0.005 * np.abs(closed).max())
    assert np.abs(stepped.state.qdot).max() < 1e-6


def test_a_small_strain_meets_the_linear_wall(duct, samples):
    stepped = Stepped(duct, samples)
    q = np.full(duct.n_modes, 1.0) / duct.omega_rad_s
    q *= 1e-3 / np.sqrt(EXPONENT) / np.linalg.norm(samples.strain @ q)
    held_force(stepped.wall.address, q, q, stepped.force)
    assert np.abs(stepped.force / (duct.omega_rad_s**2 * q)).max() < 1e-5
    for _ in range(2):
        held_force(stepped.wall.address, np.zeros(q.size), np.zeros(q.size), stepped.force)
    assert np.abs(stepped.force).max() < 1e-12


@pytest.mark.parametrize("share", [0.8, 0.95])
def test_the_force_does_the_work_of_the_energy_on_the_way_of_the_step(duct, samples, share):
    """Ways that a step takes: of one from rest to there it would be 5 % off, as the energy is no quartic."""
    stepped = Stepped(duct, samples)
    free_end = stretched(samples, loaded_states(duct, 1)[:, 0], 2.0)
    start = share * free_end
    for _ in range(6):
        held_force(stepped.wall.address, start, free_end, stepped.force)
    at = free_end + stepped.held_gain * stepped.force
    fell = wall_energy(stepped.wall.address, start) - wall_energy(stepped.wall.address, at)
    assert stepped.force @ (at - start) == pytest.approx(fell, rel=2e-3)


def test_a_wall_that_is_pulled_follows_the_exact_step_with_one_call_a_tick(duct, samples):
    """Against a solver that knows no tick before, and the mean slope on the way by its own potential."""
    wall = Stepped(duct, samples).wall
    far, root, force = stretched(samples, loaded_states(duct, 1)[:, 0], 3.0), wall.root, np.zeros(duct.n_modes)

    def value(h, free_end, start):
        total, slope = 0.5 * h @ h, h.copy()
        for point in POINTS:
            at = (samples.strain @ (start + point * (free_end + root * h - start))).reshape(-1, 3)
            beyond, stress, _ = LAW.respond(at)
            total += 0.5 * samples.energy_j @ beyond / point
            slope += 0.5 * root * ((samples.energy_j[:, None] * stress).ravel() @ samples.strain)
        return total, slope

    errors, start = [], np.zeros(duct.n_modes)
    for tick in range(300):
        free_end = far * np.sin(np.pi * tick / 300.0)
        held_force(wall.address, start, free_end, force)
        if tick % 10 == 5:
            arguments = free_end, start
            exact = minimize(value, force * root, arguments, jac=True, method="BFGS", options={"gtol": 1e-11}).x
            errors.append(np.linalg.norm(root * force - exact) / np.linalg.norm(exact))
        start = free_end + root**2 * force
    assert max(errors) < 1e-3, max(errors)


def loaded_states(basis, n):
    """(r, n) modal coordinates under patches of force all over the free wall."""
    random, free = np.random.default_rng(5), np.flatnonzero(np.abs(basis.Phi).max(axis=(1, 2)))
    load = np.zeros((n, basis.n_nodes, 3))
    for each in load:
        for place in random.integers(len(free), size=random.integers(1, 4)):
            each[free[(place + np.arange(random.integers(1, 12))) % len(free)]] += random.standard_normal(3)
    return np.einsum("nar,sna->rs", basis.Phi, load) / basis.omega_rad_s[:, None] ** 2


def test_few_triangles_stand_for_the_wall(model, duct, samples):
    every = every_triangle(model, duct, LAW)
    assert len(samples.energy_j) <= 160
    assert (samples.energy_j > 0.0).all()
    wrong = []
    for state in loaded_states(duct, 60).T:
        q = stretched(every, state, 1.5)
        wrong.append(work(samples, q) / work(every, q) - 1.0)
    assert np.median(np.abs(wrong)) < 0.01
    assert np.abs(wrong).max() < 0.15


def forms(samples, q):
    return EXPONENT * np.sum((samples.strain @ q).reshape(-1, 3) ** 2, axis=1)


def stretched(samples, q, largest):
    """The state in which the most stretched sample has this Q."""
    return q * np.sqrt(largest / forms(samples, q).max())


def work(samples, q):
    strain = (samples.strain @ q).reshape(-1, 3)
    return np.sum(samples.energy_j * np.sum(LAW.respond(strain)[1] * strain, axis=1))


@pytest.mark.parametrize("dt_s", [1e-4, 1e-3, 1e-2])
def test_a_wall_that_is_struck_again_and_again_never_gives_out_more_than_was_put_in(duct, samples, dt_s):
    """Without damping, far beyond where the law has become straight: what an explicit kick does not survive."""
    random, stepped = np.random.default_rng(3), Stepped(duct, samples, dt_s=dt_s)
    put_in, none = 0.0, np.zeros(duct.n_modes)
    largest = 0.0
    for tick in range(600):
        if tick % 100 == 0:
            before = stepped.energy_j()
            stepped.state.qdot += random.standard_normal(none.size) * 0.02
            put_in += stepped.energy_j() - before
        stepped.step(none)
        largest = max(largest, forms(samples, stepped.state.q).max())
        assert stepped.energy_j() < put_in + 0.01 * abs(put_in)
    assert largest > 0.5 * MOST_Q


@pytest.mark.parametrize("kind", [Newmark, ExactOscillator])
@pytest.mark.parametrize("dt_s", [1e-4, 1e-3])
@pytest.mark.parametrize("largest", [0.5, 3.0])
def test_a_wall_that_is_let_go_at_once_gives_out_no_more_than_it_holds(duct, samples, largest, dt_s, kind):
    """Held by forces as of a tool, which the step in which they end still expects."""
    none = np.zeros(duct.n_modes)
    for q in loaded_states(duct, 6).T:
        wall = held(Stepped(duct, samples, dt_s=dt_s, kind=kind), stretched(samples, q, largest))
        held_j = wall.energy_j()
        for tick in range(40):
            wall.step(none, expected=wall.omega**2 * wall.state.q - wall.force if tick == 0 else 0.0)
            assert wall.energy_j() < 1.01 * held_j


def held(wall, q):
    """The wall at rest at q (r,), where something holds it that is about to go."""
    free_end = wall.state.q[:] = q
    for _ in range(20):
        held_force(wall.wall.address, q, free_end, wall.force)
        free_end = q - wall.held_gain * wall.force
    wall.state.qddot[:] = wall.force - wall.omega**2 * q
    wall.wall.books[ENERGY] = wall_energy(wall.wall.address, q)
    return wall


@pytest.mark.parametrize("dt_s", [1e-4, 1e-3])
def test_blows_that_nobody_foretold_bring_out_no_more_than_they_put_in(duct, samples, dt_s):
    random, none = np.random.default_rng(8), np.zeros(duct.n_modes)
    wall, put_in, largest = Stepped(duct, samples, dt_s=dt_s), 0.0, 0.0
    for tick in range(600):
        blow = random.standard_normal(none.size) * 0.05 if tick % 50 == 0 else 0.0
        put_in += float(np.sum(blow * (wall.state.qdot + 0.5 * blow)))
        wall.step(none, blow=blow)
        largest = max(largest, forms(samples, wall.state.q).max())
        assert wall.energy_j() < put_in + 0.01 * abs(put_in)
    assert largest > 0.5 * MOST_Q


def test_what_a_wall_under_contacts_has_gained_its_rates_pay(duct, samples):
    """Contacts that go on acting were solved for where the wall is: it is not moved away under them."""
    wall = held(Stepped(duct, samples), stretched(samples, loaded_states(duct, 1)[:, 0], 2.0))
    wall.contact_impulse = wall.omega**2 * wall.state.q - wall.force
    moved, held_j, none = [], wall.energy_j(), np.zeros(duct.n_modes)
    wall.change_held = lambda held, change: moved.append(change)
    wall.step(none, expected=wall.contact_impulse)
    assert moved == []
    owed_j = -wall.wall.books[TANK]
    assert wall.energy_j() - owed_j < 1.05 * held_j


def test_sparse_weights_find_a_sum_of_few_columns():
    columns = np.abs(np.random.default_rng(2).standard_normal((60, 200)))
    chosen, weights = sparse_weights(columns, columns[:, [3, 70, 199]] @ [1.0, 2.0, 0.5], 1e-9, 20)
    found = dict(zip(chosen.tolist(), weights, strict=True))
    assert {k: round(w, 6) for k, w in found.items() if w > 1e-6} == {3: 1.0, 70: 2.0, 199: 0.5}
    assert isinstance(StretchSamples(columns, weights, LAW), StretchSamples)
