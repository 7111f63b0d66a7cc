"""What an arm applies in a running rig, beside the mechanics alone and the full finite elements.

The processes are as they are, in process; a hand holds each arm by a spring, the arm has its encoders and friction.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.sparse import csc_array

from tests.physics.conftest import SMALL
from tests.whole_rig import RATE_N_S, WholeRig
from trocar.services.gateway.instruments.instrument import PATIENCE_S
from trocar.services.gateway.motions.scene_hands import SceneHands
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import jaw_angle_from_handle
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.config import config
from trocar.services.scenes import load_scene
from trocar.services.scenes.hand_motions import hand_motions
from trocar.studies.accuracy.pinches import full_model

PACE = 0.5
#: What the books charge a hand whose reading flickers by a count of 30 um as the force changes by 1 mN: a force may be
#: late by a tenth of the tick.
OF_A_LATE_FORCE_J = 0.1 * 1e-3 * 3e-5


def test_a_pinch_is_the_full_finite_elements_and_the_arm_applies_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = replace(insertion().scene, effects={})
    rig = WholeRig(tmp_path, monkeypatch, scene, ({}, {"scenario": "insertion", "pace": PACE}))
    rig.run(3.0)
    work_j, full_j = work_of_the_wall(rig)
    assert full_j == pytest.approx(work_j, rel=0.02)
    the_arm_applies_what_is_solved(rig)


def test_a_probe_presses_as_on_the_full_finite_elements_and_the_arm_applies_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load_scene("probe", ("effects={}",))
    hands = config.build(SceneHands, {"hands": hand_motions("probe", ("effects={}",))}, "hands")
    rig = WholeRig(tmp_path, monkeypatch, scene, ({}, {"script": "scene", "pace": PACE}), hands)
    rig.run(1.7)  # it presses from 1.3 s on, and comes back from 1.9 s on
    work_j, full_j = work_of_the_wall(rig)
    assert full_j == pytest.approx(work_j, rel=0.01)
    the_arm_applies_what_is_solved(rig)
    probe = rig.moments[-1].devices.instruments[1]
    assert (probe.handle_angle_rad, probe.applied_grasp_torque_nm) == (0.0, 0.0)
    assert not any(moment.solved.reactions()[1].holds for moment in rig.moments)


def work_of_the_wall(rig: WholeRig) -> tuple[float, float]:
    """Return the work of the wall's loads on its displacements, as the rig has them and as the full elements do.

    Of a linear wall, the force that a given indentation takes goes as the force over the indentation.
    """
    last = rig.moments[-1]
    loads_n = np.zeros((rig.duct.mesh.n_vertices, 3))
    np.add.at(loads_n, last.solved.duct.load_node.view(), last.solved.duct.load_force_n.view())
    moved_m = rig.physics.simulation.duct.surface_m() - rig.duct.mesh.vertices_m
    assert np.linalg.norm(moved_m, axis=1).max() > 1e-3
    model = full_model(rig.scene.duct)
    full_m = nodal_translations(model, factorise(csc_array(model.K_free)).solve(free_load(model, loads_n)))
    return float(np.sum(loads_n * moved_m)), float(np.sum(loads_n * full_m))


def the_arm_applies_what_is_solved(rig: WholeRig) -> None:
    """Of the second tool, at rest: within 2 % of what physics found, and nothing owed."""
    last = rig.moments[-1]
    felt_n = np.array(last.devices.instruments[1].applied_force_n)
    np.testing.assert_allclose(felt_n, last.solved.reactions()[1].force_n, atol=0.02 * np.linalg.norm(felt_n))
    assert np.linalg.norm(felt_n) > 5e-3
    assert owed_j(rig) < OF_A_LATE_FORCE_J


def test_an_insertion_is_that_of_the_mechanics_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same poses of the devices, taken by the mechanics without processes between.

    Forces differ by what a frame takes: haptics sees shapes of a tick ago, and the arm a force that was solved two
    ticks ago, carried on by its stiffness. The jaws hold the duct: where they slip, how far hangs on rounding.
    """
    coarse = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=80")
    hands = config.build(SceneHands, {"hands": hand_motions("default", coarse)}, "hands")
    arm = {"script": "scene", "pace": PACE}
    rig = WholeRig(tmp_path, monkeypatch, load_scene("default", coarse), (arm, arm), hands)
    rig.run(5.0)
    alone_n, inserted_m = mechanics_alone(rig)
    assert inserted_m > 18e-3
    assert rig.moments[-1].solved.catheter.inserted_length_m == pytest.approx(inserted_m, abs=0.1e-3)
    solved_n = np.array([[tool.force_n for tool in moment.solved.reactions()] for moment in rig.moments])
    catheter, wall = relative(solved_n - alone_n, alone_n)
    assert catheter.max() < 0.01, "as it is solved, at every tick"
    assert wall.max() < 0.01
    catheter, wall = relative(rig.forces_n()[2:] - alone_n[:-2], alone_n)
    assert catheter.max() < 0.05, "as the arm applies it, two ticks later, at every tick"
    assert np.mean(wall < 0.05) > 0.999, "but for the ticks in which jaws close round the wall"
    assert np.sqrt(np.mean(wall**2)) < 0.01
    assert owed_j(rig) < OF_A_LATE_FORCE_J


def test_jaws_that_slip_on_the_wall_are_felt_without_a_kick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scenario's jaws slip. Two counts of encoders at once read as a speed, and 50 mN came where 8 were solved.

    What one count does along the wall is felt, by its stiffness there: 6 mN.
    """
    arm = {"scenario": "insertion", "pace": PACE}
    rig = WholeRig(tmp_path, monkeypatch, insertion().scene, (arm, arm))
    rig.run(1.5)
    solved_n = np.array([[tool.force_n for tool in moment.solved.reactions()] for moment in rig.moments])
    assert np.linalg.norm(solved_n[:, 1], axis=1).max() > 8e-3
    kicks_n = np.linalg.norm(rig.forces_n()[2:, 1] - solved_n[:-2, 1], axis=1)
    assert kicks_n.max() < 10e-3


def test_walls_feel_soft_and_hard_in_the_order_of_their_materials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same hand on walls of 20 kPa to 1 MPa: it meets more force, and is held further out."""
    press = {"script": str(Path(__file__).parents[1] / "rig" / "press.yaml")}
    felt_n, yielded_m = [], []
    for modulus_pa in (20e3, 100e3, 1e6):
        scene = load_scene(SMALL, (f"duct.youngs_modulus_pa={modulus_pa}", "effects={}"))
        rig = WholeRig(tmp_path, monkeypatch, scene, (press, press))
        pressed = rig.run(1.5)[-200:]
        tools = [moment.devices.instruments[0] for moment in pressed]
        felt_n.append(float(np.mean([np.linalg.norm(tool.applied_force_n) for tool in tools])))
        yielded_m.append(float(np.mean([tool.position_m[2] for tool in tools])))
        rig.gateway.close()
    assert felt_n[0] > 1e-3
    assert all(b > 1.3 * a for a, b in pairwise(felt_n)), felt_n
    assert yielded_m[-1] > yielded_m[0] + 50e-6, yielded_m


def mechanics_alone(rig: WholeRig) -> tuple[FloatArray, float]:
    """Return forces (ticks, tools, 3) for the poses that the devices had, and how much of the catheter is in."""
    simulation, tools = Simulation(rig.scene, rig.duct), ToolInputs()
    forces = np.empty((len(rig.moments), 2, 3))
    for k, moment in enumerate(rig.moments):
        for i, (device, forceps) in enumerate(zip(moment.devices.instruments, rig.scene.forceps, strict=True)):
            tools.position_m[i], tools.roll_rad[i] = device.position_m, device.roll_rad
            ratio, most = forceps.jaw_ratio, forceps.jaw_max_angle_rad
            tools.jaw_angle_rad[i] = jaw_angle_from_handle(device.handle_angle_rad, ratio, most)
        simulation.step(tools, 1e-3)
        forces[k] = simulation.tool_results.force_n
    return forces, simulation.inserted_length_m


def relative(difference_n: FloatArray, force_n: FloatArray) -> FloatArray:
    """Return the differences (ticks, tools, 3) as shares of the largest force of each tool, (tools, ticks)."""
    largest = np.linalg.norm(force_n, axis=2).max(axis=0)
    shares: FloatArray = (np.linalg.norm(difference_n, axis=2) / largest).T
    return shares


def owed_j(rig: WholeRig) -> float:
    """Return the most energy that a servo owed at any time."""
    return -min(min(moment.energy_j) for moment in rig.moments)


def test_a_hand_without_force_that_rests_in_tissue_lets_go_of_it_and_feels_it_again_once_it_was_clear(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limp hand may lead its tool to where no way back is free; jaws that had caught a duct kept force away."""
    script = tmp_path / "rest.yaml"
    out, inside = [0.020, -0.005, 0.020], [0.020, 0.0, -0.005]
    places = {0.0: out, 0.8: inside, 5.0: inside, 5.8: out, 6.2: out, 7.0: inside, 8.0: inside}
    points = [{"time_s": time_s, "hip_m": place, "handle_rad": 0.4} for time_s, place in places.items()]
    script.write_text(yaml.safe_dump({"loop": False, "motions": {"left": {"breakpoints": points}}}))
    scene = load_scene(str(SMALL), ("duct.youngs_modulus_pa=30.0e+6",))
    rig = WholeRig(tmp_path, monkeypatch, scene, ({"script": str(script)}, {}))
    rig.run(1.5)
    assert np.linalg.norm(rig.forces_n()[-1, 0]) > 1.0
    rig.tools[0].servo.engagement.let_go()
    limp = rig.run(PATIENCE_S)
    assert limp[-1].devices.instruments[0].state == "stale"
    assert limp[-1].solved.reactions()[0].contacts > 0
    rig.run(0.5)
    through = rig.moments[-1]
    assert (through.devices.withdrawn, through.solved.reactions()[0].contacts) == (0, 0)
    assert through.devices.instruments[0].state == "active"
    rig.run(4.0)
    felt_n = np.linalg.norm(rig.forces_n()[:, 0], axis=1)
    assert felt_n[round(1e3 * (1.5 + PATIENCE_S)) : 6_000].max() == 0.0
    assert felt_n[-1] > 1.0
    assert np.diff(felt_n).max() <= RATE_N_S * 1e-3 * (1.0 + 1e-9)
