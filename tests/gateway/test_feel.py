"""What is felt: the servo's law against theory, and hands that try to get energy out of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.cli.haptics import Request, run_haptics
from services.gateway import servo_law
from services.gateway.feel import measure
from services.gateway.feel.hands import attack_servo, random_attack
from services.gateway.feel.late import TICK_S, TOOLS, Late, Solved, answer_late, newest_answer
from services.gateway.feel.report import Felt, write_page
from services.gateway.feel.wall import (
    Wall,
    grows,
    measured_passive_friction,
    measured_stable_stiffness,
    passive_friction,
    released,
    response,
    stable_stiffness,
)
from services.runtime.errors import ConfigError


@pytest.mark.parametrize(
    "wall",
    [
        Wall(300.0),
        Wall(2000.0, 0.4),
        Wall(800.0, 0.3, period_s=2e-3),
        Wall(500.0, delay=1),
        Wall(500.0, delay=7),
        Wall(150.0, period_s=0.5e-3, delay=20),
    ],
    ids=str,
)
def test_a_wall_is_passive_from_the_friction_of_colgate_and_schenkel(wall: Wall) -> None:
    assert measured_passive_friction(wall) == pytest.approx(passive_friction(wall), rel=0.01)


@pytest.mark.parametrize(
    "wall",
    [
        Wall(1.0, friction_n_s_m=0.05),
        Wall(1.0, friction_n_s_m=0.1, period_s=4e-3),
        Wall(1.0, 0.3, friction_n_s_m=0.2),
        Wall(1.0, friction_n_s_m=0.5, delay=10),
        Wall(1.0, friction_n_s_m=0.1, delay=100),
    ],
    ids=str,
)
def test_a_device_is_stable_at_a_wall_up_to_the_stiffness_that_theory_gives(wall: Wall) -> None:
    assert measured_stable_stiffness(wall) == pytest.approx(stable_stiffness(wall), rel=0.05)


def test_the_passivity_controller_holds_a_wall_that_is_too_stiff_at_its_dead_band() -> None:
    """It does nothing below 10 mm/s: there the wall hums, and no louder."""
    bare = Wall(1500.0, friction_n_s_m=0.3)
    assert stable_stiffness(bare) < bare.stiffness_n_m
    assert grows(bare)
    held = np.abs(released(replace(bare, controller_n_s_m=5.0), 6000)[1000:]).max()
    assert held == pytest.approx(servo_law.STILL_M_S / math.sqrt(1500.0 / bare.mass_kg), rel=0.1)


@pytest.mark.parametrize("hertz", [1.0, 20.0, 100.0])
@pytest.mark.parametrize("delay", [None, 1, 13])
def test_a_moving_hand_meets_the_stiffness_behind_hold_and_delay(hertz: float, delay: int | None) -> None:
    """A zero-order hold is sinc(fT) and half a period late; a force over the bus is its delay later still."""
    wall = Wall(500.0)
    found = response(wall, hertz, delay)
    half = math.pi * hertz * wall.period_s
    assert abs(found) == pytest.approx(500.0 * math.sin(half) / half, rel=1e-3)
    row = measure.Rendered("", (0.5 + (delay or 0)) * 1e-3, hertz, found)
    assert row.late_deg == pytest.approx(360.0 * hertz * row.lag_s, abs=0.1)


def test_no_hand_gets_energy_out_and_without_controller_and_local_model_some_do() -> None:
    seeds = (10, 31, 40)
    # Of the others each got energy out when only the damping answered for it: that comes late, as the force does.
    late = (268, 145, 559, 678, 179)
    assert max(attack_servo(random_attack(seed)).gained_j for seed in (*seeds, *late)) <= 0.0
    bare = [attack_servo(random_attack(seed, local=False, controller=False)).gained_j for seed in seeds]
    assert max(bare) > 0.1


def test_the_page_tells_what_was_found(tmp_path: Path) -> None:
    border = measure.Border(Wall(500.0), 0.25, 0.26)
    books = tuple(attack_servo(random_attack(seed), ticks=100) for seed in (0, 1))
    found = measure.Energies("local model, controller", (random_attack(0), random_attack(1)), books)
    rendered = [measure.Rendered(name, 5e-4, 1.0, 500.0 + 0j) for name, _ in measure.WAYS]
    late = [Late(tool, 5, 0, np.array([0.01, 0.2]), np.array([0.5, 0.01])) for tool in TOOLS]
    write_page(Felt([border], [border], rendered, [found], late), ["made so"], tmp_path / "felt", tmp_path / "felt.md")
    page = (tmp_path / "felt.md").read_text(encoding="utf-8")
    assert "theory is **4.0 %**" in " ".join(page.split())
    assert f"| local model, controller | **{found.gaining}** of 2 |" in page
    assert "| 5 | 50.0%, 20.0% | 50.0%, 50.0% | 50.0%, 20.0% | 50.0%, 50.0% |" in page
    assert max(map(len, page.splitlines())) <= 120


def test_answers_come_as_late_as_is_added_and_the_newest_counts() -> None:
    assert newest_answer(6, 0, 0, np.random.default_rng(0)).tolist()[1:] == [0, 1, 2, 3, 4]
    assert newest_answer(6, 2, 0, np.random.default_rng(0)).tolist()[3:] == [0, 1, 2]
    newest = newest_answer(2000, 3, 10, np.random.default_rng(1))
    ages = np.arange(2000)[50:] - newest[50:]
    assert (ages.min(), np.diff(newest).min()) == (4, 0)
    assert 4 < ages.mean() < 9, "an answer that overtakes others counts"


def test_a_local_model_that_is_late_follows_a_wall_and_a_force_alone_is_where_it_was() -> None:
    """A hand that moves evenly in a spring: exact at 5 ms, and nothing beyond the life of a model."""
    n, stiffness = 400, 100.0
    places = np.zeros((n, 2, 3))
    places[:, :, 2] = -1e-5 * np.arange(n)[:, None]
    K = np.tile(np.diag([0.0, 0.0, stiffness]).ravel(), (n, 2, 1))
    solved = Solved(places, np.diff(places, axis=0, prepend=places[:1]) / TICK_S, -stiffness * places, K)
    at_5, at_50 = (answer_late(solved, [(ms, 0)])[0] for ms in (4, 50))
    assert at_5.local[100:].max() < 1e-3
    np.testing.assert_allclose(at_5.force_alone[100:], 5.0 / (n - 1))
    np.testing.assert_allclose(at_50.local[100:], np.arange(n)[100:] / (n - 1))
    np.testing.assert_allclose(at_50.force_alone[100:], 51.0 / (n - 1))


def test_a_page_in_a_folder_that_is_not_there_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere/felt\.md: there is no folder"):
        run_haptics(Request(1, tmp_path / "nowhere" / "felt.md", json=False))
