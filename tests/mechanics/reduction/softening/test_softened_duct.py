"""A softened wall against the nonlinear shell it was not shown, at small loads, round a cycle, and in time."""

from dataclasses import replace

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.wall_terms import terms_of
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp
from trocar.services.mechanics.fem.nonlinear import CorotationalShell, NonlinearLoad, PathSettings, trace_path
from trocar.services.mechanics.fem.nonlinear.cubic_energy import cubic_tensor_and_energies
from trocar.services.mechanics.reduction import DuctRecipe, Newmark, reduce_duct
from trocar.services.mechanics.reduction.free_dofs import free_load
from trocar.services.mechanics.reduction.large_rotations.warping import TubeWarp
from trocar.services.mechanics.reduction.nonlinear.quadratic_manifold import fetch_membrane_force
from trocar.services.mechanics.reduction.softened_wall.load_pattern import GAIN, RHO
from trocar.services.mechanics.reduction.softened_wall.pattern_change import change_pattern
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.softening import node_energy, training_mesh
from trocar.services.mechanics.reduction.softening.load_sites import Lumen
from trocar.services.mechanics.reduction.softening.node_energy import fields_of, interpolated_j, known_nodes
from trocar.services.mechanics.reduction.softening.softening_law import alike, parts, share_of_nodes
from trocar.services.mechanics.reduction.softening.training import (
    energies_of_nodes_j,
    energies_of_sites_j,
    fetch_softening,
    own_compliance_m_n,
)
from trocar.services.mechanics.reduction.softening.training_squeezes import Squeeze, follow
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries
from trocar.services.mechanics.reduction.wall_step.implicit_step import WallStep
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.accuracy.squeezed_wall import DT_S, SqueezedWall

# Training on a busy machine.
pytestmark = pytest.mark.timeout(600)

LENGTH_M, WIDTH_M = 30e-3, 8e-3


@pytest.fixture(scope="module")
def duct(cache_dir):
    mesh = parametric_duct(DuctGeometry(0.5 * WIDTH_M, LENGTH_M, 16, 16))
    section = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
    recipe = DuctRecipe(mesh, section, (clamp(mesh),), 100, ElementChoice("andes", "dkt"), n_local_modes=16)
    return reduce_duct(recipe, 0.1, cache_dir)


@pytest.fixture(scope="module")
def lumen(duct):
    return Lumen.of(duct.mesh)


@pytest.fixture(scope="module")
def softening(duct, cache_dir):
    told = []
    made = fetch_softening(duct.recipe, duct, 16, cache_dir, lambda stage, part: told.append((stage, part)))
    if told:  # it was trained now; one that was kept from another run is found without a word
        assert told[0][0] == "cubic energy"
        parts_told = [part for stage, part in told if stage == "squeezes of the wall"]
        assert parts_told == pytest.approx(np.linspace(0, 1, 17))
    return made


def jaws(lumen, mesh, squeeze):
    """Nodes and lines of a squeeze whose patches are single nodes."""
    inward = lumen.inward[squeeze.node]
    if not squeeze.is_pinch:
        return np.array([squeeze.node]), inward[None]
    opposite = mesh.vertices_m[squeeze.node] + lumen.width_m[squeeze.node] * inward
    other = int(np.linalg.norm(mesh.vertices_m - opposite, axis=1).argmin())
    return np.array([squeeze.node, other]), np.stack([inward, -inward])


def node_at(mesh, x_m, angle_rad):
    place = np.array([x_m, 0.5 * WIDTH_M * np.cos(angle_rad), 0.5 * WIDTH_M * np.sin(angle_rad)])
    return int(np.linalg.norm(mesh.vertices_m - place, axis=1).argmin())


UNSEEN = [
    ("pinch in the middle", 15e-3, 1.0, 0.5, True),
    ("pinch near the mouth", 26e-3, 2.0, 0.5, True),
    ("pinch near the clamp", 9e-3, 0.0, 0.4, True),
    ("pinch beside the clamp", 3.75e-3, 0.2, 0.4, True),
    ("pinch where it hardly gives way", 1.875e-3, 0.2, 0.3, True),
    ("poke in the middle", 17e-3, 4.0, 0.4, False),
    ("poke at the mouth", 30e-3, 5.0, 0.4, False),
    ("pull", 10e-3, 1.2, -0.15, False),
    ("pull near the clamp", 7.5e-3, 1.0, -0.17, False),
    ("pull on the first row", 1.875e-3, 3.0, -0.12, False),
]


@pytest.mark.parametrize(
    ("name", "x_m", "angle_rad", "depth", "is_pinch"),
    by_day(UNSEEN[1:8:3] + UNSEEN[9:], [*UNSEEN[::3][:3], *UNSEEN[2:9:3]]),
)
def test_force_is_that_of_the_nonlinear_shell(duct, lumen, softening, name, x_m, angle_rad, depth, is_pinch):
    """At every part of the way; a linear wall is up to twice as stiff."""
    squeeze = Squeeze(node_at(duct.mesh, x_m, angle_rad), depth * WIDTH_M, 0.0, is_pinch)
    nodes, lines = jaws(lumen, duct.mesh, squeeze)
    pressed, before = SqueezedWall(duct, softening, nodes, lines), np.zeros(len(nodes))
    for part, state in enumerate(follow(duct.recipe, lumen, squeeze), 1):
        wanted = np.full(len(nodes), part / 5.0 * squeeze.depth_m / len(nodes))
        force, _ = pressed.squeeze(wanted, start_m=before)
        before = wanted
        true = np.sum(state.force_n * lines, axis=1).sum()
        assert force.sum() == pytest.approx(true, rel=0.12)


class BentWall(SqueezedWall):
    """A squeezed wall under a load on its modes (r,) as well, of which ``part`` acts."""

    modal = part = 0.0

    def __post_init__(self):
        super().__post_init__()
        hold_relaxed = self.terms.hold_relaxed

        def load_and_hold():
            self.body.modal_force += self.part * self.modal
            hold_relaxed()

        self.terms.hold_relaxed = load_and_hold


def test_a_duct_that_is_bent_while_it_is_squeezed_has_the_force_of_the_nonlinear_shell(duct, softening):
    """By a fifth of its length, across the jaws. No training state was bent; the error is 7 % at most."""
    mesh, recipe, depth_m = duct.mesh, duct.recipe, 0.4 * WIDTH_M
    nodes = np.array([node_at(mesh, 15e-3, angle) for angle in (0.0, np.pi)])
    lines, mouth = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]), mesh.vertex_sets["mouth"]
    aside, imposed = np.zeros((2, mesh.n_vertices, 6))
    aside[mouth, 2] = 1.0
    aside *= 0.2 * LENGTH_M / recipe.model().solve_static(aside[:, :3]).displacement_m[mouth, 2].mean()
    imposed[nodes, :3] = 0.5 * depth_m * lines
    held = [Support(np.array([node], np.int32), ("uy",)) for node in nodes]
    shell = CorotationalShell(ShellModel(mesh, recipe.section, [*recipe.supports, *held], recipe.elements))
    path = trace_path(shell, NonlinearLoad(aside, 0.0, imposed), PathSettings(4, tolerance=1e-6))
    assert np.mean((path[-1].at.position_m - mesh.vertices_m)[mouth, 2]) > 0.15 * LENGTH_M
    pressed = BentWall(duct, softening, nodes, lines)
    pressed.modal = np.einsum("nar,na->r", duct.basis.Phi, aside[:, :3])
    for point in path:
        for part in [*np.linspace(pressed.part, point.part, 150), *np.full(100, point.part)]:
            pressed.part = part
            force = pressed.step(np.full(2, 0.5 * depth_m * part))
        assert force.sum() == pytest.approx(np.sum(point.reaction[nodes, :3] * lines), rel=0.12)


@pytest.mark.parametrize(("name", "x_m", "angle_rad", "depth", "is_pinch"), by_day(UNSEEN[1:2], [UNSEEN[0], UNSEEN[8]]))
def test_beside_the_nonlinear_membrane_a_squeeze_is_counted_once(
    duct, lumen, softening, cache_dir, name, x_m, angle_rad, depth, is_pinch
):
    """The polynomial is that of what the pattern does not move."""
    nodes, lines = jaws(lumen, duct.mesh, Squeeze(node_at(duct.mesh, x_m, angle_rad), 0.0, 0.0, is_pinch))
    wanted = np.full(len(nodes), depth * WIDTH_M / len(nodes))
    alone, both = (SqueezedWall(duct, softening, nodes, lines) for _ in range(2))
    both.terms.polynomial = fetch_membrane_force(duct.recipe, duct.basis, 12, cache_dir)
    one, other = (wall.squeeze(wanted)[0].sum() for wall in (alone, both))
    assert other == pytest.approx(one, rel=0.02)


@pytest.mark.parametrize(
    ("name", "x_m", "angle_rad", "depth", "is_pinch"),
    by_day([UNSEEN[3], UNSEEN[6]], [UNSEEN[0], UNSEEN[5], *UNSEEN[7:]]),
)
def test_a_squeeze_that_is_held_relaxes_by_the_law(duct, lumen, softening, name, x_m, angle_rad, depth, is_pinch):
    """All of the force: what softening took was elastic before, so that half of it was left where 0.7 is."""
    nodes, lines = jaws(lumen, duct.mesh, Squeeze(node_at(duct.mesh, x_m, angle_rad), 0.0, 0.0, is_pinch))
    wanted, series = np.full(len(nodes), depth * WIDTH_M / len(nodes)), PronySeries((0.2, 0.1), (0.2, 0.5))
    damped = replace(duct, damping_ratio=np.full(duct.basis.n_modes, 0.7))
    elastic, relaxing = (SqueezedWall(damped, softening, nodes, lines, each) for each in (NEVER, series))
    held = [relaxing.step(wanted).sum() / elastic.step(wanted).sum() for _ in range(4000)]
    at = np.array([200, 600, 4000])
    np.testing.assert_allclose(np.array(held)[at - 1], series.relaxation(1e-3 * at), rtol=0.01)


def test_a_force_between_sites_has_its_own_cubic_energy(duct, lumen, softening):
    """The law's first term is exact wherever the wall is pressed, not only on a site."""
    model = duct.recipe.model()
    free = np.unique(model.free_dofs // 6)
    nodes = np.random.default_rng(4).choice(np.setdiff1d(free, softening.sites.nodes), 12, replace=False)
    _, own_j = cubic_tensor_and_energies(
        CorotationalShell(model), np.zeros((model.n_dofs, 1)), fields_of(model, nodes, lumen.inward[nodes])
    )
    forces = [(np.array([node]), lumen.inward[[node]]) for node in nodes]
    np.testing.assert_allclose([energies_of_sites_j(softening, *force)[1] for force in forces], own_j, rtol=0.01)
    # The sharp fields of the nodes are cut off.
    np.testing.assert_allclose([energies_of_nodes_j(softening, *force)[1] for force in forces], own_j, rtol=0.035)


def loads_between_sites(lumen, mesh):
    """Pinches and pokes of one to a dozen nodes, as pairs of nodes (k,) and forces (k, 3)."""
    random, loads = np.random.default_rng(5), []
    for k in range(12):
        node = int(random.choice(np.flatnonzero(mesh.vertices_m[:, 0] > 2e-3)))
        middle, inward = mesh.vertices_m[node], lumen.inward[node]
        sides = [middle] if k % 3 == 0 else [middle, middle + lumen.width_m[node] * inward]
        away = [np.linalg.norm(mesh.vertices_m - side, axis=1) for side in sides]
        patches = [np.flatnonzero(each <= each.min() + random.uniform(0.0, 2e-3)) for each in away]
        forces = [
            np.outer(random.uniform(0.5, 1.0, len(p)), w * inward) for p, w in zip(patches, (1, -1), strict=False)
        ]
        loads.append((np.concatenate(patches), np.concatenate(forces)))
    return loads


def exact_cubic_j(model, loads):
    """Cubic energy of the linear response to each."""
    spread = np.zeros((len(loads), model.mesh.n_vertices, 3))
    for load, (nodes, force_n) in zip(spread, loads, strict=True):
        np.add.at(load, nodes, force_n)
    fields = np.zeros((model.n_dofs, len(loads)))
    fields[model.free_dofs] = model.factor.solve(np.stack([free_load(model, each) for each in spread], axis=1))
    return cubic_tensor_and_energies(CorotationalShell(model), fields[:, :1], fields)[1]


def test_forces_on_nodes_have_their_cubic_energy(duct, lumen, softening):
    """Sites alone are a third off, depending on how they lie."""
    loads = loads_between_sites(lumen, duct.mesh)
    exact_j = exact_cubic_j(duct.recipe.model(), loads)
    of_nodes, of_sites = (
        np.array([energies_j(softening, *load)[1] for load in loads])
        for energies_j in (energies_of_nodes_j, energies_of_sites_j)
    )
    assert np.abs(of_nodes / exact_j - 1.0).max() < 0.15
    assert np.abs(of_sites / exact_j - 1.0).max() > 0.25


@pytest.mark.parametrize("x_m", [1.875e-3, 9.375e-3, 11.25e-3, 13.125e-3, 26e-3])
def test_a_pattern_has_both_laws_by_their_shares(duct, lumen, softening, x_m):
    """Whatever either law says, however many ticks a pattern takes; beside the clamp there is one law only."""
    nodes, lines = jaws(lumen, duct.mesh, Squeeze(node_at(duct.mesh, x_m, 1.0), 0.0, 0.0, True))
    force_n, laws = lines * np.array([[0.02], [0.03]]), softening.laws
    share = float(np.array([0.4, 0.6]) @ laws.share[nodes])
    own = [energies_j(softening, nodes, force_n) for energies_j in (energies_of_sites_j, energies_of_nodes_j)]
    V, E = (1.0 - share) * np.array(own[0]) + share * np.array(own[1])
    pattern = pattern_of(duct, softening, nodes, force_n)
    assert pattern.numbers[RHO] == pytest.approx(-E / V, rel=1e-4)
    # Between 0.1 and 0.6 the law of one place is too steep, and its slope is bounded.
    theta = np.array([0.0, 0.05, 0.1, 0.6]) / np.abs(pattern.numbers[RHO])
    work = np.zeros(len(theta))
    for part, (V_own, E_own), law in zip((1.0 - share, share), own, (laws.of_sites, laws.of_nodes), strict=True):
        mean = np.array([0.4, 0.6]) @ law.coefficients[nodes]
        work += part * V_own * np.interp(-theta * E_own / V_own, law.rho, mean @ law.work)
    made = np.interp(theta * pattern.numbers[RHO], laws.of_sites.rho, pattern.work)
    np.testing.assert_allclose(made, work / V, atol=1e-3)


def pattern_of(duct, softening, nodes, force_n):
    """What a tick makes of forces that stay."""
    soft, none = SoftenedWall.of(duct, softening), np.zeros(duct.basis.n_modes)
    wall = WallStep.of(duct.basis.omega_rad_s**2, pattern=soft.new_pattern())
    modal = np.einsum("kar,ka->r", duct.basis.Phi[nodes], force_n)
    loads = nodes.astype(np.int32), force_n
    for _ in range(60):
        change_pattern(soft.address, wall.address, loads, modal, (none, none[None][:0]), DT_S)
    return wall.pattern


def test_what_a_law_shares_goes_smoothly_from_a_support_on():
    far = np.linspace(0.0, 3.0, 301)
    share = share_of_nodes(far)
    assert np.all(share[far <= 1.0] == 0.0)
    assert np.all(share[far >= 2.0] == 1.0)
    assert np.abs(np.diff(share, 2)).max() < 1e-3


def test_energies_of_a_wall_of_many_nodes_are_interpolated(duct, lumen):
    """From half of them, to some per cent but for the few nodes where the wall changes from one to the next."""
    model, own_m_n = (
        duct.recipe.model(),
        np.einsum("na,nab,nb->n", lumen.inward, own_compliance_m_n(duct), lumen.inward),
    )
    free = known_nodes(duct.mesh, own_m_n)
    _, own_j = cubic_tensor_and_energies(
        CorotationalShell(model), np.zeros((model.n_dofs, 1)), fields_of(model, free, lumen.inward[free])
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(node_energy, "OWN_NODES_MAX", 200)
        patch.setattr(node_energy, "OF_MORE", len(free) // 2)
        known = known_nodes(duct.mesh, own_m_n)
    assert len(known) == len(free) // 2
    among = np.searchsorted(free, known)
    made = interpolated_j(duct.mesh, own_m_n, known, own_j[among])[free]
    np.testing.assert_allclose(made[among], own_j[among], rtol=1e-12)
    error = np.abs(made / own_j - 1.0)
    assert np.median(np.delete(error, among)) < 0.05
    assert np.percentile(error, 90) < 0.2


def test_the_law_varies_faster_beside_a_support():
    """Places as far from one another are less alike beside a support than in the middle, relative to their own."""
    from_support = np.array([0.1, 0.6, 5.0, 5.5])
    distance = np.abs(from_support[:, None] - from_support[None])
    K = alike(distance, from_support, from_support)
    correlation = K / np.sqrt(np.outer(np.diag(K), np.diag(K)))
    assert np.linalg.eigvalsh(K).min() > 0.0
    assert K[0, 0] > 2.0 * K[2, 2]
    assert K[0, 0] + K[1, 1] - 2.0 * K[0, 1] > 10.0 * (K[2, 2] + K[3, 3] - 2.0 * K[2, 3])
    assert correlation[2, 3] == pytest.approx(np.exp(-0.5 * (0.5 / 1.5) ** 2), abs=0.01)


FINE_NODES_MAX, COARSE_NODES = 200, 140


@pytest.fixture(scope="module")
def softening_of_fewer_nodes(duct, cache_dir):
    """Trained on half the duct's nodes, as a duct of many is; kept as the others are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_mesh, "FINE_NODES_MAX", FINE_NODES_MAX)
        patch.setattr(training_mesh, "COARSE_NODES", COARSE_NODES)
        followed = training_mesh.training_recipe(duct.recipe)
        assert followed.mesh.n_vertices < 180 < duct.mesh.n_vertices
        held = followed.mesh.vertices_m[followed.supports[0].vertices, 0]
        assert len(held) >= 6
        assert np.allclose(held, 0.0)
        made = fetch_softening(duct.recipe, duct, 16, cache_dir / f"taught-by-{COARSE_NODES}-of-{FINE_NODES_MAX}")
        assert made.remainder.third.size == 0
        return made


@pytest.mark.parametrize(("name", "x_m", "angle_rad", "depth", "is_pinch"), by_day([UNSEEN[0]], [UNSEEN[1], UNSEEN[6]]))
def test_squeezes_of_fewer_nodes_teach_as_much(
    duct, lumen, softening_of_fewer_nodes, name, x_m, angle_rad, depth, is_pinch
):
    squeeze = Squeeze(node_at(duct.mesh, x_m, angle_rad), depth * WIDTH_M, 0.0, is_pinch)
    nodes, lines = jaws(lumen, duct.mesh, squeeze)
    wanted = np.full(len(nodes), squeeze.depth_m / len(nodes))
    force, _ = SqueezedWall(duct, softening_of_fewer_nodes, nodes, lines).squeeze(wanted)
    true = np.sum(follow(duct.recipe, lumen, squeeze)[-1].force_n * lines, axis=1).sum()
    assert force.sum() == pytest.approx(true, rel=0.12)


def test_a_wall_given_triangle_by_triangle_is_followed_with_what_lies_there(duct):
    mesh = duct.mesh
    thickness_m = np.where(mesh.vertices_m[mesh.triangles].mean(axis=1)[:, 0] < 15e-3, 0.5e-3, 1e-3)
    section = replace(duct.recipe.section, thickness_m=thickness_m)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_mesh, "FINE_NODES_MAX", 200)
        patch.setattr(training_mesh, "COARSE_NODES", 140)
        followed = training_mesh.training_recipe(replace(duct.recipe, section=section))
    middle = followed.mesh.vertices_m[followed.mesh.triangles].mean(axis=1)[:, 0]
    assert followed.section.thickness_m.shape == middle.shape
    assert np.all(followed.section.thickness_m[middle < 13e-3] == 0.5e-3)
    assert np.all(followed.section.thickness_m[middle > 17e-3] == 1e-3)


def test_a_small_load_meets_the_linear_wall(duct, lumen, softening):
    """What is missing from the linear force falls with the load: a tenth of the closure, a tenth of it."""
    squeeze = Squeeze(node_at(duct.mesh, 15e-3, 1.0), 0.5 * WIDTH_M, 0.0, True)
    nodes, lines = jaws(lumen, duct.mesh, squeeze)
    missing = []
    for closure in (1e-3, 1e-4):
        wanted = np.full(2, 0.5 * closure * WIDTH_M)
        force, _ = SqueezedWall(duct, softening, nodes, lines).squeeze(wanted, 600)
        compliance = sum(own_compliance_between(duct, nodes, lines))
        missing.append(1.0 - force.sum() / (2.0 * wanted.sum() / compliance))
    assert 0.0 < missing[0] < 5e-3
    assert missing[1] == pytest.approx(0.1 * missing[0], rel=0.1)


def own_compliance_between(duct, nodes, lines):
    """(k,) displacement along the lines under unit forces along all of them."""
    model = duct.recipe.model()
    load = np.zeros((duct.mesh.n_vertices, 3))
    load[nodes] = lines
    return np.sum(model.solve_static(load).displacement_m[nodes] * lines, axis=1)


@pytest.mark.parametrize("parts_of_width", [(0.25, 0.25), (0.45, 0.05)])
def test_a_slow_cycle_gives_next_to_nothing_back_that_was_not_put_in(duct, lumen, softening, parts_of_width):
    """Closed in 1.4 s and opened again: the force on the modes has done no work, but for what it lags behind them."""
    squeeze = Squeeze(node_at(duct.mesh, 15e-3, 1.0), 0.5 * WIDTH_M, 0.0, True)
    nodes, lines = jaws(lumen, duct.mesh, squeeze)
    pressed, closed = SqueezedWall(duct, softening, nodes, lines), np.array(parts_of_width) * WIDTH_M
    _, closing = pressed.squeeze(closed, 2400)
    _, opening = pressed.squeeze(np.zeros(2), 2400, closed)
    assert pressed.terms.energy_j() == pytest.approx(0.0, abs=1e-6 * closing)
    assert 0.0 <= pressed.terms.dissipated_j <= 0.01 * closing
    assert closing + opening > 0.0


def test_a_dead_load_comes_to_rest_where_the_shell_does(duct, lumen, softening):
    squeeze = Squeeze(node_at(duct.mesh, 15e-3, 1.0), 0.4 * WIDTH_M, 0.0, True)
    nodes, lines = jaws(lumen, duct.mesh, squeeze)
    state = follow(duct.recipe, lumen, squeeze)[-1]
    force, pressed = np.sum(state.force_n * lines, axis=1), SqueezedWall(duct, softening, nodes, lines)
    for tick in range(1500):
        pressed.step(force_n=force * min(1.0, tick / 500))
    assert np.abs(pressed.body.rate()).max() < 1e-5 * np.abs(pressed.body.state.q).max() / DT_S
    assert pressed.displacement_m().sum() == pytest.approx(0.4 * WIDTH_M, rel=0.15)


def test_what_is_let_go_is_forgotten(duct, lumen, softening):
    nodes, lines = jaws(lumen, duct.mesh, Squeeze(node_at(duct.mesh, 15e-3, 1.0), 1e-3, 0.0, True))
    pressed = SqueezedWall(duct, softening, nodes, lines)
    pressed.squeeze(np.full(2, 1e-3))
    for _ in range(300):
        pressed.step(force_n=np.zeros(2))
    held, *_ = pressed.terms.state_arrays()
    assert not held.any()
    assert not pressed.terms.softened.at_sites.any()
    assert pressed.terms.step.pattern.numbers[GAIN] == 0.0


def test_zero_is_a_point_of_the_law(softening):
    for law in (softening.laws.of_sites, softening.laws.of_nodes):
        assert np.count_nonzero(law.rho == 0.0) == 1
        inside = np.abs(law.rho) < 0.05
        np.testing.assert_array_equal(law.work[:, inside], parts(law.rho[inside]))


def test_it_is_found_again(duct, softening, cache_dir):
    def refuse(stage, part):
        raise AssertionError(f"{stage} is computed again")

    again = fetch_softening(duct.recipe, duct, 16, cache_dir, refuse)
    np.testing.assert_array_equal(again.third, softening.third)
    np.testing.assert_array_equal(again.remainder.third, softening.remainder.third)
    np.testing.assert_array_equal(again.laws.of_nodes.coefficients, softening.laws.of_nodes.coefficients)


def test_own_compliance_is_that_of_the_full_model(duct, lumen):
    node = node_at(duct.mesh, 20e-3, 0.3)
    load = np.zeros((duct.mesh.n_vertices, 3))
    load[node, 1] = 1.0
    moved = duct.recipe.model().solve_static(load).displacement_m[node]
    np.testing.assert_allclose(own_compliance_m_n(duct)[node, :, 1], moved, rtol=1e-5, atol=1e-8)


def test_supports_that_hold_some_axes_are_refused(duct, lumen):
    recipe = replace(duct.recipe, supports=(*duct.recipe.supports, Support(np.array([200], np.int32), ("ux",))))
    with pytest.raises(ValueError, match="hold all axes"):
        follow(recipe, lumen, Squeeze(100, 1e-3, 0.0, True))


def test_a_surface_without_lumen_is_refused(duct):
    mesh = replace(duct.mesh, triangles=np.ascontiguousarray(duct.mesh.triangles[:, ::-1]))
    with pytest.raises(ValueError, match="no lumen"):
        Lumen.of(mesh)


def test_a_bent_duct_is_squeezed_by_the_law_of_a_straight_one(duct, lumen, softening):
    """Forces that turn with the wall's sections make the same pattern, wherever these look."""
    nodes, lines = jaws(lumen, duct.mesh, Squeeze(node_at(duct.mesh, 22e-3, 1.0), 0.0, 0.0, True))
    warp = TubeWarp.from_basis(duct.mesh, duct.basis, duct.mesh.vertex_sets["clamped"])
    bent = replace(duct, warp=warp)
    rho = []
    for each, part in ((duct, 0.0), (bent, 0.0), (bent, 1.0)):
        body = DuctBody(each, Newmark(duct.basis.omega_rad_s, 0.1), 2)
        terms = terms_of(body)
        terms.softened = SoftenedWall.of(each, softening)
        body.state.q[0] = part * 15e-3 / np.abs(duct.basis.Phi[:, :, 0]).max()
        body.predict(DT_S)
        forces = body.turn_to_world(nodes, 0.02 * lines)
        turned_rad = np.arccos(np.clip(np.sum(forces * lines, axis=1) / 0.02, -1.0, 1.0))
        assert turned_rad.max() >= 0.2 * part
        body.load_nodes[:2], body.load_force_n[:2] = nodes, forces
        body._n_loads[:] = 2
        body.contact_impulse[:] = np.einsum("kar,ka->r", duct.basis.Phi[nodes], 0.02 * lines)
        for _ in range(20):
            terms.hold(DT_S)
            terms.settle(lambda: 0.0, DT_S)
            body.turn_loads()
            terms.end_step(DT_S)
        assert terms.step.pattern.numbers[GAIN] != 0.0
        rho.append(float(terms.step.pattern.numbers[RHO]))
    assert rho == pytest.approx([rho[0]] * 3, rel=1e-6)
