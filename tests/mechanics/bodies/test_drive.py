"""A catheter driven from behind: what it is pushed, twisted and steered by, against closed forms and the books."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.contact.identity import hold_identity
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.scene import CatheterSection, DriveScene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.energy_book import EnergyBook

LENGTH_M, BENDING_M = 0.1, 0.03
STEER_1_M_RAD = 30.0
DRIVE = DriveScene(coupling_stiffness_n_m=2000.0)


@pytest.fixture
def driven(small_scene, small_duct):
    """The catheter's tip 8 mm before its introducer's exit, which is 8 mm before the mouth; the drive behind it."""

    def build(tools=(DRIVE,), length_m=LENGTH_M, **catheter):
        section = CatheterSection(length_m=BENDING_M, steering_1_m_rad=(STEER_1_M_RAD, 0.0, 0.0))
        placed = replace(
            small_scene.catheter, n_segments=50, length_m=length_m, tip_position_m=(50e-3, 0.0, 0.0),
            introducer_to_tip_m=40e-3, introducer_length_m=length_m - 40e-3, sections=(section,),
            internal_damping_s=2e-3, **catheter,
        )  # fmt: skip
        scene = replace(small_scene, catheter=placed, forceps=tools, effects={"twist": NoSettings()})
        return Simulation(scene, small_duct)

    return build


def inputs():
    tools = ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = (50e-3 + LENGTH_M + 2e-3, 0.0, 0.0)
    return tools


def lead(simulation, tools, *, pushed_m=0.0, rolled_rad=0.0, handle_rad=0.0, ticks=400, rest=800, book=None):
    """Move evenly there and stay."""
    start = tools.position_m[0].copy(), tools.roll_rad[0], tools.jaw_angle_rad[0]
    step = simulation.step if book is None else book.step
    for tick in range(ticks + rest):
        share = min((tick + 1) / ticks, 1.0)
        tools.position_m[0] = start[0] - share * np.array([pushed_m, 0.0, 0.0])
        tools.roll_rad[0], tools.jaw_angle_rad[0] = start[1] + share * rolled_rad, start[2] + share * handle_rad
        step(tools)


def test_a_push_moves_all_of_it_and_the_hand_feels_the_seal(driven):
    simulation, tools = driven(introducer_seal_friction_n=0.2), inputs()
    simulation.step(tools)
    lead(simulation, tools, pushed_m=15e-3)
    moved_m = simulation.catheter.state.position_m[:, 0] - (50e-3 + np.linspace(LENGTH_M, 0.0, 51))
    np.testing.assert_allclose(moved_m, -15e-3, atol=0.3e-3)  # the coupling gives by 0.1 mm
    felt = simulation.tool_results.force_n[0]
    assert felt[0] == pytest.approx(0.2, rel=0.05)
    assert np.abs(felt[1:]).max() < 1e-3


def test_steering_gives_the_section_its_curvature_and_the_roll_its_direction(driven):
    """To 0.1 %: the angle between its ends is curvature times length, and turns with the drive through any angle."""
    simulation, tools = driven(), inputs()
    simulation.step(tools)
    lead(simulation, tools, handle_rad=0.8, rest=2500)

    def bend():
        edges = np.diff(simulation.catheter.state.position_m[-14:], axis=0)
        edges /= np.linalg.norm(edges, axis=1)[:, None]
        turn = np.arccos(np.sum(edges[1:] * edges[:-1], axis=1)).sum()
        return turn / (12 * LENGTH_M / 50), edges[-1]

    curvature, before = bend()
    assert curvature == pytest.approx(0.8 * STEER_1_M_RAD, rel=1e-3)
    lead(simulation, tools, rolled_rad=2.0 * np.pi + 1.2, ticks=3000, rest=2500)
    curvature, after = bend()
    assert curvature == pytest.approx(0.8 * STEER_1_M_RAD, rel=1e-3)
    first, second = (np.arctan2(tip[2], tip[1]) for tip in (before, after))
    assert abs((second - first) % (2.0 * np.pi) - 1.2) < 1.2e-3  # about -x


def test_the_books_close_while_it_is_pushed_twisted_and_steered(driven):
    """Without a seal, whose friction would hide the rest: bent against the wall, and turned there."""
    simulation, tools = driven(), inputs()
    simulation.step(tools)
    book = EnergyBook(simulation)
    lead(simulation, tools, pushed_m=20e-3, rest=0, book=book)
    lead(simulation, tools, rolled_rad=3.0, handle_rad=0.9, rest=200, book=book)
    assert simulation.drive.work_j > 1e-5
    assert book.flow.input_j > 0.0
    assert abs(book.flow.imbalance_j) < 0.01 * book.flow.input_j
    assert simulation.healed_states == 0


def test_a_drive_that_is_taken_away_lets_go_and_takes_hold_anew(driven):
    simulation, tools = driven(), inputs()
    simulation.step(tools)
    (number,) = simulation.holds.active
    assert hold_identity(number) < 0  # no contact's
    tools.present[0] = False
    simulation.step(tools)
    assert not simulation.holds.active
    tools.present[0], tools.roll_rad[0] = True, 1.0
    simulation.step(tools)
    before = simulation.catheter.state.frame.m1.copy()
    for _ in range(5):
        simulation.step(tools)
    np.testing.assert_allclose(simulation.catheter.state.frame.m1, before, atol=1e-9)
    assert simulation.refused_inputs == 0
