"""The local model that the servo evaluates: what it takes from a reaction, and that its force is the simulation's."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tests.haptics.models import local_model
from tests.physics.conftest import Rig
from trocar.protocol.bodies import InstrumentState, LocalModel, ToolReaction
from trocar.services.mechanics.contact.lasting_compliance import LASTING_S
from trocar.services.mechanics.scene import ForcepsScene

INSTRUMENT = InstrumentState(
    name="0",
    position_m=(0.01, 0.02, 0.03),
    velocity_m_s=(0.1, -0.2, 0.3),
)
FORCEPS = ForcepsScene(coupling_damping_n_s_m=0.7, jaw_ratio=2.0)
REACTION = ToolReaction(
    force_n=(0.1, 0.2, 0.3),
    stiffness_n_m=(3.0, 1.0, 0.0, 1.0, 2.0, 0.5, 0.0, 0.5, 1.0),
    position_m=(0.011, 0.021, 0.031),
    grasp_torque_nm=0.02,
    grasp_stiffness_nm_rad=0.3,
    jaw_angle_rad=0.5,
    contacts=1,
)
FREE = LocalModel()
#: Projects on a direction.
NORMAL = np.outer((2.0, -1.0, 2.0), (2.0, -1.0, 2.0)) / 9.0
CENTRE, FAR = (0.02, 0.0, 0.006), (0.02, -0.05, 0.08)
DT_S = 1e-3


def test_a_tool_that_touches_gets_what_physics_solved_about_where_it_solved_it() -> None:
    model = local_model(REACTION, INSTRUMENT, FORCEPS, touching=True)
    assert model.in_contact
    assert model.force_n == REACTION.force_n
    assert model.stiffness_n_m == REACTION.stiffness_n_m
    assert model.reference_position_m == REACTION.position_m
    assert model.reference_velocity_m_s == INSTRUMENT.velocity_m_s


@pytest.mark.parametrize(("world_n_m", "felt"), [(0.0, 0.0), (50.0, 1.0 / 121.0), (500.0, 0.25), (1e9, 1.0)])
def test_the_damping_felt_is_the_couplings_in_series_with_what_it_touches(world_n_m: float, felt: float) -> None:
    """A coupling and a spring in series, moved slowly: the force's part in phase with the motion, over its rate."""
    coupling = FORCEPS.coupling_stiffness_n_m
    stiffness = coupling * world_n_m / (coupling + world_n_m)
    model = local_model(
        msgspec.structs.replace(REACTION, stiffness_n_m=along(stiffness)), INSTRUMENT, FORCEPS, touching=True
    )
    s = 2j * np.pi * 0.01
    damped = coupling + 0.7 * s
    B = (damped * world_n_m / (damped + world_n_m)).imag / s.imag
    np.testing.assert_allclose(np.reshape(model.damping_n_s_m, (3, 3)), B * NORMAL, atol=1e-6)
    assert pytest.approx(0.7 * felt, abs=1e-5) == B


def along(stiffness_n_m: float) -> tuple[float, ...]:
    return tuple((stiffness_n_m * NORMAL).ravel().tolist())


def test_damping_takes_energy_whatever_the_stiffness() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        half = random.normal(0.0, 20.0, (3, 3))
        K = tuple((half @ half.T).ravel().tolist())
        model = local_model(msgspec.structs.replace(REACTION, stiffness_n_m=K), INSTRUMENT, FORCEPS, touching=True)
        B = np.reshape(model.damping_n_s_m, (3, 3))
        np.testing.assert_array_equal(B, B.T)
        assert np.linalg.eigvalsh(B).min() > -1e-12


def test_torque_and_stiffness_of_the_jaws_are_felt_at_the_handle() -> None:
    """The jaws open twice as fast as the handle: by virtual work torque counts twice, stiffness four times."""
    model = local_model(REACTION, INSTRUMENT, FORCEPS, touching=True)
    assert model.grasp_torque_nm == pytest.approx(0.04)
    assert model.grasp_stiffness_nm_rad == pytest.approx(1.2)
    assert model.reference_angle_rad == pytest.approx(0.25)


@pytest.mark.parametrize(("contacts", "holds", "touching"), [(0, 0, True), (1, 0, False), (0, 1, False), (2, 2, False)])
def test_no_force_comes_of_nothing(contacts: int, holds: int, touching: bool) -> None:
    """Neither from a reaction without a contact nor from one that is too old to act on."""
    reaction = ToolReaction(force_n=(1.0, 1.0, 1.0), grasp_torque_nm=0.1, contacts=contacts, holds=holds)
    assert local_model(reaction, INSTRUMENT, FORCEPS, touching=touching) == FREE


@pytest.mark.parametrize(("contacts", "holds"), [(1, 0), (0, 1)])
def test_a_contact_or_a_hold_is_enough(contacts: int, holds: int) -> None:
    reaction = ToolReaction(force_n=(1.0, 1.0, 1.0), contacts=contacts, holds=holds)
    assert local_model(reaction, INSTRUMENT, FORCEPS, touching=True).force_n == (1.0, 1.0, 1.0)


def press(rig: Rig, ticks: int) -> None:
    """Lower J until the jaws are in the wall, and hold it there."""
    for k in range(ticks):
        height_m = CENTRE[2] + 0.004 * max(0.0, 1.0 - 4.0 * k / ticks)
        rig.turn((*CENTRE[:2], height_m), FAR)


@pytest.fixture(params=[0.0, 1.0], ids=["undamped", "damped"])
def pressed(request: pytest.FixtureRequest, in_memory: type[Rig]) -> tuple[Rig, float]:
    rig = in_memory(f"forceps=[{{coupling_damping_n_s_m: {request.param}}}, {{}}]")
    press(rig, 800)
    return rig, request.param


def test_it_predicts_the_force_on_a_tool_that_moves_evenly_for_as_long_as_it_is_used(
    pressed: tuple[Rig, float],
) -> None:
    """K against the simulation itself: 5 um in 5 ms, which make nothing slide, change its force by -K (x - x0).

    K is the coupling's spring in series with the wall as it gives way over that time, taken as one step of backward
    Euler: so nearly. What the wall gives way in one tick would be twice as stiff.
    """
    rig, _ = pressed
    ticks = round(LASTING_S / DT_S)
    for move_m in np.vstack([5e-6 * np.eye(3), -5e-6 * np.eye(3)]):
        for _ in range(100):  # back, and at rest
            rig.turn(CENTRE, FAR)
        model = rig.model()
        assert model.in_contact
        assert model.reference_position_m == CENTRE
        for tick in range(ticks):
            rig.turn(tuple((np.array(CENTRE) + (tick + 1) / ticks * move_m).tolist()), FAR)
        predicted = -np.reshape(model.stiffness_n_m, (3, 3)) @ move_m
        change = rig.physics.simulation.tool_results.force_n[0] - np.array(model.force_n)
        assert np.linalg.norm(change - predicted) < 0.25 * np.linalg.norm(predicted)


def test_its_stiffness_is_symmetric_and_a_spring_no_stiffer_than_the_coupling(pressed: tuple[Rig, float]) -> None:
    rig, _ = pressed
    K = np.reshape(rig.model().stiffness_n_m, (3, 3))
    np.testing.assert_allclose(K, K.T, atol=1e-9 * np.abs(K).max())
    eigenvalues = np.linalg.eigvalsh(K)
    assert eigenvalues.min() > -1e-9 * eigenvalues.max()
    assert 10.0 < eigenvalues.max() <= rig.physics.simulation.scene.forceps[0].coupling_stiffness_n_m


def test_out_of_contact_and_for_an_absent_tool_it_is_zero(in_memory: type[Rig]) -> None:
    rig = in_memory()
    press(rig, 100)
    assert rig.model().in_contact
    for _ in range(250):  # 90 mm, at the half a metre a second at which physics follows
        rig.turn(FAR, FAR)
    assert rig.models() == (FREE, FREE)
    press(rig, 300)
    for _ in range(3):
        rig.turn(CENTRE)  # the second tool is gone
    touching, *others = rig.models()
    assert touching.in_contact
    assert others == []
    for _ in range(250):
        rig.turn(FAR, FAR, CENTRE)  # a third, of which mechanics knows nothing
    assert rig.models() == (FREE, FREE, FREE)
