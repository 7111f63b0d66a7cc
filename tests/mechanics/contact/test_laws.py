"""The table of contact laws: every law is asked through it, and nobody asks which law a row has."""

import ast
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

from trocar import services
from trocar.services.mechanics.contact.admissible import (
    closed_axes,
    normal_range,
    project,
    slides,
    step_to_bounds,
    tangential_limit,
)
from trocar.services.mechanics.contact.identity import LAW
from trocar.services.mechanics.contact.laws import LAWS, NO_LOAD_M_N, number_of
from trocar.services.mechanics.contact.penalty import PenaltyGains, write_penalties
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.system import STRATEGIES
from trocar.services.mechanics.contact.writer import append_row
from trocar.services.mechanics.scene import ContactSettings

SERVICES = Path(services.__file__).parent


def row_of(law, **columns):
    """One row under a law, its frame that of the world."""
    rows = ContactRows.zeros(c=1)
    row = append_row(rows, number_of(law), 0)
    rows.frame[row] = np.eye(3)
    for name, value in columns.items():
        getattr(rows, name)[row] = value
    return rows


def names_a_law(node):
    """Whether an expression is a row's law or its number."""
    is_column = isinstance(node, ast.Subscript) and isinstance(node.value, ast.Attribute) and node.value.attr == "law"
    return is_column or (isinstance(node, ast.Name) and node.id.lstrip("_").lower() in LAWS)


def test_laws_and_strategies_are_compared_nowhere():
    found = []
    for path in SERVICES.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Compare):
                continue
            sides = [node.left, *node.comparators]
            is_model = any(isinstance(s, ast.Attribute) and ast.unparse(s).endswith("contact.model") for s in sides)
            if is_model or any(map(names_a_law, sides)):
                found.append(f"{path.relative_to(SERVICES)}:{node.lineno}: {ast.unparse(node)}")
    assert found == []


@pytest.mark.parametrize("text", ["rows.law[row] == 1", "law == _GRIP", "film != kind"])
def test_the_search_finds_such_comparisons(text):
    compare = ast.parse(text, mode="eval").body
    assert any(map(names_a_law, [compare.left, *compare.comparators]))


def test_a_scene_can_name_every_strategy_and_no_other():
    assert set(get_args(get_type_hints(ContactSettings)["model"])) == set(STRATEGIES)


def test_the_identity_has_room_for_all_laws():
    assert len(LAWS) <= LAW.size


SETS = {
    "unilateral": ((0.0, np.inf), 0.3 * 0.2),
    "grip": ((-np.inf, np.inf), 0.5),
    "film": ((-np.inf, np.inf), np.inf),
    "seal": ((-0.5, 0.5), 0.0),
    "squeeze": ((0.0, np.inf), 0.0),
    "pull": ((-0.5, 0.0), 0.0),
}


@pytest.mark.parametrize("law", LAWS)
def test_every_law_admits_its_set(law):
    rows = row_of(law, friction=0.3, force_limit_n=0.5, force_n=[0.2, 0.0, 0.0])
    assert rows.softness_m_n.min() > 0.0
    assert normal_range(rows, 0) == SETS[law][0]
    assert tangential_limit(rows, 0) == pytest.approx(SETS[law][1])


@pytest.mark.parametrize("law", ["grip", "seal"])
def test_what_is_limited_to_nothing_bears_nothing(law):
    rows = row_of(law, force_limit_n=0.0, force_n=[0.2, 0.1, 0.0])
    project(rows, 0, False)
    assert not rows.force_n.any()
    assert slides(rows, 0)
    assert closed_axes(rows, 0, False) == 0


@pytest.mark.parametrize(
    ("law", "force_n", "is_sliding", "axes"),
    [
        ("unilateral", 0.0, False, 0),
        ("unilateral", 0.2, False, 3),
        ("unilateral", 0.2, True, 1),
        ("grip", 0.2, False, 3),
        ("grip", 0.2, True, 1),
        ("film", 0.2, False, 0),
        ("seal", 0.2, False, 1),
        ("seal", 0.5, True, 0),
        ("squeeze", 0.2, False, 1),
        ("squeeze", 0.0, False, 0),
    ],
)
def test_axes_that_stay_closed_when_a_body_is_moved(law, force_n, is_sliding, axes):
    rows = row_of(law, friction=0.3, force_limit_n=0.5, force_n=[force_n, 0.0, 0.0])
    assert closed_axes(rows, 0, is_sliding) == axes


def penalty(rows, gains=(100.0, 0.1, 1e-3, 1e-6)):
    write_penalties(rows, PenaltyGains(*gains))
    return rows.force_n[0]


def test_penalty_of_a_contact_is_spring_damper_and_friction_of_its_coefficient():
    rows = row_of("unilateral", gap_m=-1e-3, slip_m=[-1e-5, 3e-5, 0.0], friction=0.3)
    f_n = 100.0 * (1e-3 + 0.5e-5) + 0.1 * 1e-5 / 1e-3
    assert penalty(rows) == pytest.approx([f_n, -0.3 * f_n, 0.0])
    assert penalty(row_of("unilateral", gap_m=1e-6, slip_m=[-1e-6, 1e-3, 0.0], friction=0.3)) == pytest.approx(0.0)


@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
def test_penalty_throws_a_particle_back_no_faster_than_it_came(share):
    """A mass under a force held over each step, on a spring of ``share`` m / dt^2: explicit at the start it gains."""
    dt_s, mass_kg, speeds = 1e-3, 2e-6, []
    x, v = 3.3e-6, -0.02
    for _ in range(400):
        rows = row_of("unilateral", gap_m=x, slip_m=[v * dt_s, 0.0, 0.0])
        force_n = penalty(rows, (share * mass_kg / dt_s**2, 0.0, dt_s, mass_kg))[0]
        x, v = x + dt_s * (v + 0.5 * dt_s * force_n / mass_kg), v + dt_s * force_n / mass_kg
        x, v = (x, -v) if x > 1e-3 else (x, v)  # sent back to the wall each time
        speeds.append(abs(v))
    assert max(speeds) <= 0.02 * 1.001


@pytest.mark.parametrize("point", range(4))
def test_penalty_damper_of_a_particle_does_not_turn_it_round(point):
    """c dt is thirty times its mass. A contact at the end of a segment has its weight on the second particle."""
    rows = row_of("unilateral", gap_m=-1e-9, slip_m=[-2e-5, 0.0, 0.0], rod_weight=np.eye(4)[point])
    assert penalty(rows, (0.0, 0.06, 1e-3, 2e-6))[0] * 1e-3 == pytest.approx(0.5 * 2e-6 * 0.02)


def test_penalty_of_a_grip_has_no_limit_across_the_jaws():
    slip = np.array([5e-3, 3e-3, -4e-3])
    assert penalty(row_of("grip", slip_m=slip)) == pytest.approx(-100.0 * slip)
    limited = penalty(row_of("grip", slip_m=slip, force_limit_n=0.1))
    assert limited == pytest.approx([-0.5, -0.06, 0.08])


@pytest.mark.parametrize("viscosity", [0.5, 2.0])
def test_penalty_of_a_film_is_its_viscosity_times_the_rate(viscosity):
    """b v with v the slip over the step; the spring of the contacts has no part in it."""
    dt_s, b = 1e-3, viscosity * 1e-2
    rows = row_of("film", slip_m=[5e-6, 3e-6, -2e-6], softness_m_n=[NO_LOAD_M_N, dt_s / b, dt_s / b])
    assert penalty(rows, (1e4, 7.0, dt_s, 1.0)) == pytest.approx([0.0, -b * 3e-3, b * 2e-3])


def test_penalty_of_two_films_stops_a_particle_in_a_step_and_does_not_throw_it_back():
    """However viscous: an explicit force that did would be larger in every step."""
    dt_s, mass_kg, rate_m_s = 1e-3, 3e-6, 0.2
    rows = row_of(
        "film",
        slip_m=[0.0, rate_m_s * dt_s, 0.0],
        softness_m_n=[NO_LOAD_M_N, 1e-6, 1e-6],
        rod_weight=[1.0, 0.0, 0.0, 0.0],
    )
    assert 2.0 * penalty(rows, (1.0, 0.0, dt_s, mass_kg))[1] * dt_s == pytest.approx(-mass_kg * rate_m_s)


@pytest.mark.parametrize("law", ["unilateral", "seal", "squeeze", "grip"])
def test_a_change_of_force_goes_as_far_as_the_law_admits_it_and_no_further(law):
    """What there is room for, projection leaves as it is; a thousandth more it does not."""
    random, short = np.random.default_rng(3), 0
    for _ in range(300):
        rows = row_of(law, friction=0.3, force_limit_n=0.5)
        rows.force_n[0] = random.normal(0.0, 0.5, 3)
        project(rows, 0, False)
        start = rows.force_n[0] * (0.99, 0.9, 0.9)
        axes = {"seal": 1, "squeeze": 1}.get(law, 3)
        change = np.where(np.arange(3) < axes, random.normal(0.0, 1.0, 3), 0.0)
        rows.force_n[0] = start
        if start[0] == 0.0 or slides(rows, 0):
            continue
        share = step_to_bounds(rows, 0, tuple(change), False)
        assert 0.0 < share <= 1.0
        for part, is_admitted in ((0.999 * share, True), (1.001 * share, share == 1.0)):
            rows.force_n[0] = start + part * change
            wanted = rows.force_n[0].copy()
            project(rows, 0, False)
            if part <= 1.0:
                assert (np.abs(rows.force_n[0] - wanted).max() < 1e-12) == is_admitted
        short += share < 1.0
    assert short > 30


def test_a_sliding_force_stays_on_the_edge_of_its_disk_and_does_not_limit_a_change():
    rows = row_of("unilateral", friction=0.3, force_n=[1.0, 0.2, 0.1])
    project(rows, 0, True)
    assert np.hypot(*rows.force_n[0, 1:]) == pytest.approx(0.3)
    assert rows.force_n[0, 1] == pytest.approx(2.0 * rows.force_n[0, 2])
    assert step_to_bounds(rows, 0, (0.5, 0.4, 0.0), True) == 1.0
    assert step_to_bounds(rows, 0, (-4.0, 0.0, 0.0), True) == pytest.approx(0.25)
