"""The local model of a grasp says what the torque at the handle becomes when the handle moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.haptics.models import local_model
from tests.physics.conftest import SMALL
from trocar.protocol.bodies import InstrumentState, LocalModel, ToolReaction, ToolState
from trocar.protocol.bodies.haptics import tool_table
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.contact.lasting_compliance import LASTING_S
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import ForcepsScene, SceneModel
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.physics.outputs import Outputs
from trocar.services.scenes import load_duct, load_scene

RATIO = 1.6
STEP_RAD = 1e-4
TICKS = 60
LASTING_TICKS = round(LASTING_S / 1e-3)

Hands = Callable[[int, ToolInputs], None]


@pytest.fixture(scope="module")
def small() -> tuple[SceneModel, ReducedDuct]:
    scene = load_scene(SMALL)
    return scene, load_duct(scene, cache_directory(), lambda stage, fraction: None)


def _scene(scene: SceneModel, **forceps: float) -> SceneModel:
    """Both forceps reach straight down at the middle of the duct and open across it."""
    each = ForcepsScene(port_position_m=(0.02, 0.0, 0.15), jaw_ratio=RATIO, **forceps)
    return replace(scene, forceps=(each, each))


def _squeeze_wall(tick: int, tools: ToolInputs) -> None:
    """The jaws of the first tool close round the tube, which gives way between them."""
    tools.present[:] = True, False
    tools.position_m[0] = 0.02, 0.0, 0.013
    tools.roll_rad[0] = 0.5 * np.pi
    tools.jaw_angle_rad[0] = 0.95 - 0.2 * min(1.0, tick / (0.7 * TICKS))
    tools.holds = []


def _hold_catheter(tick: int, tools: ToolInputs) -> None:
    """The jaws of the first tool hold the catheter behind the mouth and squeeze it."""
    tools.present[:] = True, False
    tools.position_m[0] = 0.06, 0.0, 0.010
    tools.roll_rad[0] = 0.5 * np.pi
    tools.jaw_angle_rad[0] = 0.3 - 0.1 * min(1.0, tick / (0.7 * TICKS))
    weights = np.array([0.5, 0.5, 0.0])
    tools.holds = [GraspHold(1, 0, CATHETER_SEGMENT, 5, weights, 2.0, 0.28)]


def _reaction(scene: SceneModel, duct: ReducedDuct, hands: Hands, turned_rad: float) -> ToolReaction:
    """What physics says of the first tool if its jaws are asked for so much more, evenly over the last ticks."""
    simulation, tools = Simulation(scene, duct), ToolInputs()
    for tick in range(TICKS):
        hands(tick, tools)
        tools.jaw_angle_rad[0] += turned_rad * max(0.0, 1.0 - (TICKS - 1 - tick) / LASTING_TICKS)
        simulation.step(tools)
    told = ToolState(position_m=tuple(tools.position_m[0]), jaw_angle_rad=float(tools.jaw_angle_rad[0]))
    return Outputs(simulation, "").state(TICKS, tool_table([told])).reactions()[0]


def _model(reaction: ToolReaction, forceps: ForcepsScene) -> LocalModel:
    return local_model(reaction, InstrumentState(name="", position_m=(0, 0, 0)), forceps, touching=True)


def _torque_nm(reaction: ToolReaction, scene: SceneModel, handle_rad: float) -> float:
    """What the servo makes of the local model at a handle angle, at the rate that the model was made for."""
    model = _model(reaction, scene.forceps[0])
    assert model.in_contact
    return model.grasp_torque_nm - model.grasp_stiffness_nm_rad * (handle_rad - model.reference_angle_rad)


@pytest.mark.parametrize(("hands", "share"), [(_squeeze_wall, 0.25), (_hold_catheter, 1e-3)])
def test_the_model_predicts_the_torque_of_jaws_that_move(
    small: tuple[SceneModel, ReducedDuct], hands: Hands, share: float
) -> None:
    """Without dampers in the couplings the torque changes by the spring's alone; a wall lets go of its inertia."""
    scene, duct = _scene(small[0], coupling_damping_n_s_m=0.0, jaw_damping_nm_s_rad=0.0), small[1]
    before, after = (_reaction(scene, duct, hands, turned) for turned in (0.0, STEP_RAD))
    assert before.grasp_torque_nm > 1e-4, "nothing is squeezed"
    change = _torque_nm(before, scene, after.jaw_angle_rad / RATIO) - before.grasp_torque_nm * RATIO
    assert change < 0.0
    assert change == pytest.approx((after.grasp_torque_nm - before.grasp_torque_nm) * RATIO, rel=share)


@pytest.mark.parametrize("hands", [_squeeze_wall, _hold_catheter])
def test_the_dampers_of_the_couplings_are_not_taken_for_springs(
    small: tuple[SceneModel, ReducedDuct], hands: Hands
) -> None:
    """Over a tick this damper is ten times the spring; what the spring gives way is the same."""
    bare, damped = (_scene(small[0], jaw_damping_nm_s_rad=damping) for damping in (0.0, 2e-3))
    spring, felt = (_reaction(scene, small[1], hands, 0.0).grasp_stiffness_nm_rad for scene in (bare, damped))
    assert felt == pytest.approx(spring, rel=0.01)


def test_a_handle_beyond_the_stops_of_its_jaws_does_not_change_the_torque() -> None:
    forceps = ForcepsScene(jaw_ratio=RATIO)
    for angle, moves in [(0.0, False), (0.3, True), (forceps.jaw_max_angle_rad, False)]:
        reaction = ToolReaction(grasp_torque_nm=0.1, grasp_stiffness_nm_rad=0.2, contacts=1, jaw_angle_rad=angle)
        model = _model(reaction, forceps)
        assert (model.grasp_stiffness_nm_rad > 0.0) is moves
        assert (model.grasp_damping_nm_s_rad > 0.0) is moves
