"""The work of a roll, against a case whose balance is known; the other entries are tested with what they are about."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.energy_book import EnergyBook, EnergyFlow
from trocar.studies.stability.drive import reduced_duct
from trocar.studies.stability.hands import still
from trocar.studies.stability.situations import beside, with_catheter, without_friction

OPEN_RAD, ROLL_RAD, STEPS = 0.7, 0.15, 90
LEAD = 20


def push_aside(by: Literal["roll", "shift"]) -> tuple[EnergyFlow, float]:
    """Push a clamped catheter aside with one jaw, straight down from its port, without friction, within 90 ms.

    The point of the jaw that touches goes the same way, by the roll or by a shift of the hand. Return the books, and
    how far the catheter was pushed.
    """
    scene = without_friction(beside().scene)
    tool = replace(scene.forceps[0], port_position_m=(66e-3, 0.0, 150e-3))
    jaw_m = tool.jaws.jaw_length_m
    height_m = jaw_m * np.cos(0.5 * OPEN_RAD) - 2e-3  # the catheter 2 mm above the tips
    beside_m = tool.jaws.jaw_radius_m + 0.5 * scene.catheter.outer_diameter_m + 0.02e-3
    scene = with_catheter(
        replace(scene, effects={}, forceps=(tool,)),
        anchor="clamped",
        length_m=80e-3,
        n_segments=40,
        tip_position_m=(24e-3, beside_m, 0.0),
    )
    u = np.arange(1, STEPS + 1) / STEPS
    rolled_rad = ROLL_RAD * u**3 * (10.0 + u * (6.0 * u - 15.0))
    hands = still(np.array([(66e-3, 0.0, height_m), (0.0, 0.0, 60e-3)]), (OPEN_RAD, 0.0), LEAD)
    hands = replace(hands, roll_rad=np.zeros_like(hands.roll_rad)).then(STEPS)
    if by == "roll":
        hands = hands.rolled(0, rolled_rad, LEAD)
    else:
        arm_m = height_m * np.tan(0.5 * OPEN_RAD)
        leverage = 1.0 + height_m / (150e-3 - height_m)
        hands = hands.moved(0, np.outer(arm_m * np.sin(rolled_rad) / leverage, (0.0, 1.0, 0.0)), LEAD)
    simulation, tools = Simulation(scene, reduced_duct(scene)), ToolInputs()
    line_m = simulation.catheter.state.position_m
    for step in range(len(hands)):
        hands.write(step, tools)
        tools.holds = []
        if step == 0:
            simulation.step(tools)
            book = EnergyBook(simulation)
        else:
            book.step(tools)
    return book.flow, float(line_m[:, 1].max()) - beside_m


def test_what_a_roll_pushes_aside_has_its_energy_from_the_hand() -> None:
    flow, pushed_m = push_aside("roll")
    assert pushed_m > 0.3e-3
    assert flow.stored_j > 0.3e-6
    taken_j = flow.stored_j + flow.rod_j + flow.duct_j + flow.coupling_j
    assert flow.input_j == pytest.approx(taken_j, rel=0.05)
    assert abs(flow.imbalance_j) < 1e-4 * flow.input_j


def test_a_roll_works_as_a_shift_does_that_moves_the_touching_point_alike() -> None:
    """Nothing rolls in the second run, whose input is that of the couplings alone; contact lags more in the first."""
    (rolled, rolled_m), (shifted, shifted_m) = push_aside("roll"), push_aside("shift")
    assert rolled_m == pytest.approx(shifted_m, rel=0.06)
    assert rolled.input_j / rolled.stored_j == pytest.approx(shifted.input_j / shifted.stored_j, rel=0.1)
