"""A clip: it holds the catheter with the friction of what presses it, from both sides, and leaks above a pressure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, NO_TOOL
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.rows import NO_STONE
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct, check_scene_duct
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes.duct_file import duct_file
from trocar.services.training.site import read_site
from trocar.services.training.situation import Loads
from trocar.studies.energy_book import EnergyBook

AT_M, CLOSING_N = 6e-3, 0.5
PARTICLE = 15  # held by a grasp that never slips, outside the duct
MU = 0.15


def clipped(with_effects, small_duct, mu=MU, slides=(), **settings):
    """A catheter 15 mm in a duct, with nothing else that holds it; the clip has closed."""
    effects = {
        "clip": {"at_m": AT_M, "closing_force_n": CLOSING_N, "closing_time_s": 0.1, **settings},
        "friction": {"mu_static": mu, "mu_kinetic": mu},
    }
    scene = with_effects(**effects)
    catheter = replace(scene.catheter, viscous_drag_n_s_m2=0.0, **dict(slides))
    simulation = Simulation(replace(scene, catheter=catheter), small_duct)
    tools = ToolInputs()
    tools.present[:] = False
    for _ in range(250):
        simulation.step(tools)
    return simulation


class Pull:
    """One point of the catheter held by a hand that moves out of the duct."""

    def __init__(self, simulation, dt_s):
        self.simulation, self.tools, self.dt_s = simulation, ToolInputs(), dt_s
        self.tools.present[0] = False
        self.at = simulation.catheter.state.position_m[PARTICLE] + np.array([0.0, 0.0, 8e-3])
        self.tools.holds = [GraspHold(1, 1, CATHETER_SEGMENT, PARTICLE, np.array([1.0, 0.0, 0.0]), 100.0, 0.3)]

    def to(self, way_m):
        """Take a step and return the force along the duct with which the hand pulls."""
        self.tools.position_m[1] = self.at + np.array([way_m, 0.0, 0.0])
        self.simulation.step(self.tools, dt_s=self.dt_s)
        rows, n = self.simulation.contacts, self.simulation.contacts.n_contacts
        return float(np.abs(self.simulation.contact_force_n[rows.law[:n] == number_of("grip"), 0].sum()))


def wall_resists_n(simulation):
    """What the full shell needs to be pressed by both legs from its rest to the catheter: not of the contact solve."""
    clip, reduced = simulation.effects["clip"].state, simulation.duct.reduced
    load = np.zeros_like(reduced.mesh.vertices_m)
    for leg in range(2):
        corners = reduced.mesh.triangles[clip.triangle[leg]]
        load[corners] += clip.weights[leg][:, None] * clip.towards[leg]
    moved = reduced.recipe.model().solve_static(load).displacement_m
    gives_m_n = sum(
        clip.weights[leg] @ moved[reduced.mesh.triangles[clip.triangle[leg]]] @ clip.towards[leg] for leg in range(2)
    )
    scene = simulation.scene
    between_m = scene.catheter.outer_diameter_m + scene.duct.thickness_m
    return (float(np.linalg.norm(clip.rest_m[1] - clip.rest_m[0])) - between_m) / gives_m_n


def test_both_sides_are_pressed_by_the_force_of_the_clip_less_what_the_wall_resists(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct)
    clip = simulation.effects["clip"].state
    resists_n = wall_resists_n(simulation)
    assert 0.1 * CLOSING_N < resists_n < 0.7 * CLOSING_N
    assert clip.pull_n == CLOSING_N
    assert clip.pressing_n == pytest.approx(CLOSING_N - resists_n, rel=0.04)  # facets beside the legs share
    apart_m = np.linalg.norm(clip.place_m[1] - clip.place_m[0])
    touching_m = simulation.scene.catheter.outer_diameter_m + simulation.scene.duct.thickness_m
    assert touching_m - 5e-6 < apart_m < touching_m + 0.15e-3  # flat facets of 3 mm touch a little beside the legs


def test_a_score_takes_the_common_load_of_both_sides_as_the_clip_does(with_effects, small_duct):
    """An attempt is judged without the mechanics, so the rule stands in both."""
    simulation = clipped(with_effects, small_duct)
    clip, rows, n = simulation.effects["clip"].state, simulation.contacts, simulation.contacts.n_contacts
    under = np.linalg.norm(rows.point_m[:n] - clip.place_m.mean(axis=0), axis=1) < clip.reach_m
    under &= (rows.duct_weight[:n] != 0.0).any(axis=1) & (rows.tool[:n] == NO_TOOL) & (rows.stone[:n] == NO_STONE)
    pressing_n = np.maximum(rows.force_n[:n, :1], 0.0) * rows.frame[:n, 0]
    assert clip.pressing_n > 0.2
    assert Loads(pressing_n).sides(under)[1] == pytest.approx(clip.pressing_n, rel=1e-9)


@pytest.mark.parametrize("mu", [0.08, 0.25])
@pytest.mark.parametrize("dt_s", by_day([1e-3], [2.5e-4]))
def test_the_catheter_slips_at_mu_times_what_presses_both_of_its_sides(with_effects, small_duct, mu, dt_s):
    simulation = clipped(with_effects, small_duct, mu=mu)
    limit_n = 2.0 * mu * (CLOSING_N - wall_resists_n(simulation))
    pull, way_m, speed_m_s = Pull(simulation, dt_s), 5e-3, 20e-3
    n = round(way_m / speed_m_s / dt_s)
    tip_m = simulation.catheter.state.position_m[-1, 0]
    clip, pulled_n, pressed_n = simulation.effects["clip"].state, [], []
    for tick in range(n + 1):
        pulled_n.append(pull.to(way_m * tick / n))
        pressed_n.append(clip.pressing_n)
    assert max(pulled_n) == pytest.approx(limit_n, rel=0.04)
    assert max(pulled_n) == pytest.approx(2.0 * mu * np.mean(pressed_n), rel=0.02)
    assert simulation.catheter.state.position_m[-1, 0] - tip_m > 1e-3


def test_below_that_force_it_holds_without_creeping(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct, mu=0.3)
    limit_n = 2.0 * 0.3 * (CLOSING_N - wall_resists_n(simulation))
    pull, way_m = Pull(simulation, 1e-3), 0.0
    while pull.to(way_m) < 0.7 * limit_n:
        way_m += 2e-6
    for _ in range(200):
        began_n = pull.to(way_m)
    began_m = simulation.catheter.state.position_m[-1, 0]
    for _ in range(500):
        ended_n = pull.to(way_m)
    assert 0.5 * limit_n < ended_n < 0.9 * limit_n
    assert ended_n == pytest.approx(began_n, rel=0.01)
    assert simulation.catheter.state.position_m[-1, 0] == pytest.approx(began_m, abs=1e-6)


def test_without_friction_it_presses_and_does_not_hold(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct, mu=0.0)
    pull = Pull(simulation, 1e-3)
    pulled_n = [pull.to(20e-6 * tick) for tick in range(200)]
    assert simulation.effects["clip"].state.pressing_n > 0.2
    assert max(pulled_n) < 0.05


def test_it_leaks_where_the_pressure_on_the_flattened_lumen_lifts_its_legs(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct, leg_width_m=2e-3)
    clip = simulation.effects["clip"]
    area_m2 = 2e-3 * math.pi * (4e-3 - 0.5e-3)
    assert clip.leak_pressure_pa * area_m2 == pytest.approx(CLOSING_N - wall_resists_n(simulation), rel=0.04)


def test_a_clip_too_weak_for_the_wall_does_not_reach_the_catheter_and_leaks_at_once(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct, closing_force_n=0.1)
    clip = simulation.effects["clip"]
    assert clip.state.pull_n == 0.1
    assert clip.state.pressing_n < 1e-6
    assert clip.leak_pressure_pa < 1.0


def test_a_catheter_that_has_been_pulled_out_leaves_the_clip_open(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct, mu=0.0)
    pull = Pull(simulation, 1e-3)
    for tick in range(700):
        pull.to(20e-6 * tick)
    clip = simulation.effects["clip"].state
    assert simulation.inserted_length_m < AT_M
    assert clip.pull_n == clip.pressing_n == 0.0


def test_what_closing_gives_is_what_is_stored_and_lost(with_effects, small_duct):
    """Whoever closes it works against a force that grows while the legs come together; nothing is lost yet."""
    simulation = clipped(with_effects, small_duct)
    clip = simulation.effects["clip"]
    state = clip.state
    before_m = float(np.linalg.norm(state.rest_m[1] - state.rest_m[0]))
    after_m = float(np.linalg.norm(state.place_m[1] - state.place_m[0]))
    stored_j = clip.potential_energy_j(simulation.world)
    # It follows the wall a step behind, and a step moves its legs by less than a ten thousandth of their distance.
    assert stored_j == pytest.approx(CLOSING_N * after_m, rel=1e-4)
    assert clip.dissipated_j == 0.0
    assert CLOSING_N * after_m < clip.given_j < CLOSING_N * before_m


@pytest.mark.parametrize("closes_along", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)])
def test_a_clip_that_is_dragged_about_gives_out_no_more_than_it_was_closed_with(with_effects, small_duct, closes_along):
    """Its pulls have a potential also while the wall moves sideways under the plates."""
    clip = {"at_m": AT_M, "closing_force_n": CLOSING_N, "closing_time_s": 0.1, "closes_along": closes_along}
    simulation = Simulation(with_effects(clip=clip, friction={}), small_duct)
    book, spent_j = EnergyBook(simulation), [0.0]
    hold = Pull(simulation, 1e-3)
    for tick in range(700):
        around = 2.0 * np.pi * max(tick - 200, 0) / 250.0
        hold.tools.position_m[1] = hold.at + 2e-3 * np.array([0.0, math.sin(around), 1.0 - math.cos(around)])
        book.step(hold.tools)
        spent_j.append(book.flow.input_j - book.flow.stored_j)
    scale_j = book.flow.input_j
    assert abs(book.flow.imbalance_j) < 1e-6 * scale_j
    assert (np.maximum.accumulate(spent_j) - spent_j).max() < 0.01 * scale_j
    assert simulation.effects["clip"].given_j > 0.1 * scale_j


def test_a_clip_on_a_wall_that_turns_gives_out_no_more_either(with_effects, cache_dir):
    """Legs beside the catheter have a moment, which the section bears that turns the plates."""
    clip = {"at_m": AT_M, "closing_force_n": CLOSING_N, "closing_time_s": 0.1}
    scene = with_effects(clip=clip, friction={}, large_rotations={})
    scene = replace(scene, duct=replace(scene.duct, youngs_modulus_pa=30e3))
    simulation = Simulation(scene, build_scene_duct(scene, cache_dir))
    book, spent_j, turned_rad, most_j = EnergyBook(simulation), [0.0], 0.0, 0.0
    hold, state = Pull(simulation, 1e-3), simulation.effects["clip"].state
    closes = state.towards[0].copy()
    for tick in range(700):
        around = 2.0 * np.pi * max(tick - 200, 0) / 250.0
        hold.tools.position_m[1] = hold.at + 4e-3 * np.array([0.0, math.sin(around), 1.0 - math.cos(around)])
        book.step(hold.tools)
        spent_j.append(book.flow.input_j - book.flow.stored_j)
        turned_rad = max(turned_rad, math.acos(min(float(closes @ state.towards[0]), 1.0)))
        most_j = max(most_j, abs(book.flow.imbalance_j))
    assert turned_rad > 0.1
    assert most_j < 1e-3 * book.flow.input_j
    assert (np.maximum.accumulate(spent_j) - spent_j).max() < 0.01 * book.flow.input_j


def test_it_closes_by_jaws_only_when_these_squeeze_as_hard_as_it_will(with_effects, small_duct):
    simulation = clipped(with_effects, small_duct, closes="by_jaws")
    clip = simulation.effects["clip"].state
    assert not clip.is_closed
    assert clip.pull_n == clip.pressing_n == 0.0
    tools = ToolInputs()
    tools.present[1] = False
    tools.roll_rad[0] = 0.5 * np.pi  # jaws that open across the duct
    squeezed_n = 0.0
    # The first port is above the duct: jaws come down over it at the clip, open, and close.
    at_m = np.array([34e-3, 0.0, 10e-3])
    tools.jaw_angle_rad[0] = 1.1
    for tick in range(1500):
        tools.position_m[0] = at_m + np.array([0.0, 0.0, max(20e-3 - 40e-6 * tick, 0.0)])
        tools.jaw_angle_rad[0] = 1.1 - 1.0 * min(max(tick - 600, 0) / 600, 1.0)
        simulation.step(tools)
        if not clip.is_closed:
            squeezed_n = max(squeezed_n, clip.squeezed_n)
    assert clip.is_closed
    assert squeezed_n <= CLOSING_N
    tools.present[:] = False
    for _ in range(300):
        simulation.step(tools)
    assert clip.pressing_n > 0.2


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"at_m": 0.0}, "at_m must be positive, is 0.0"),
        ({"closing_force_n": -1.0}, "closing_force_n must be positive, is -1.0"),
        ({"closing_time_s": 0.0}, "closing_time_s must be positive, is 0.0"),
        ({"closes_along": [0.0, 0.0, 0.0]}, "closes_along must not be zero"),
        ({"closes": "later"}, "closes"),
    ],
)
def test_a_setting_that_makes_no_clip_is_refused_by_its_key(with_effects, settings, sentence):
    with pytest.raises(ConfigError, match=rf"effects\.clip.*{sentence}"):
        with_effects(clip=settings)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"at_m": 0.2}, "effects.clip.at_m: the duct has no wall 200 mm behind its mouth, it ends before"),
        ({"closes_along": (1.0, 0.0, 0.0)}, r"effects.clip.closes_along: \[1.0, 0.0, 0.0\] is along the duct there"),
    ],
)
def test_a_clip_that_this_duct_has_no_place_for_is_refused_by_its_key(with_effects, settings, sentence):
    with pytest.raises(ValueError, match=sentence):
        check_scene_duct(with_effects(clip=settings))


def test_its_place_is_told_to_who_judges(with_effects, small_duct):
    scene = with_effects(clip={"at_m": AT_M})
    told = read_site(duct_file(small_duct, scene))
    assert told.clip_m == pytest.approx((40e-3 - AT_M, 0.0, 0.0), abs=0.1e-3)
    assert told.clip_reach_m == pytest.approx(8e-3, rel=0.05)
    assert read_site(duct_file(small_duct, with_effects())).clip_m is None
