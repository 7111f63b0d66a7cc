"""Haptics and physics together: forces out of mechanics, wrong frames refused, a NaN survived."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import pytest

from tests.health_reports import report_of
from tests.memory_bus import MemoryBus
from tests.physics.conftest import STALE_S, Rig
from trocar.protocol import Frame
from trocar.protocol.arrays import pack
from trocar.protocol.bodies import GatewayState, HeldPoint, InstrumentState
from trocar.protocol.bodies.haptics import tool_table
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.physics.inputs import ContactsReader

FAR = (0.02, -0.05, 0.08)


def _hold(rig: Rig, height_m: float, ticks: int) -> None:
    """Keep J of the first tool at a height above the axis, half way along the duct."""
    for _ in range(ticks):
        rig.turn((0.02, 0.0, height_m), FAR)


def _press(rig: Rig, ticks: int, down_to_m: float = 0.006) -> None:
    """Lower J from above until the jaws are in the wall."""
    for k in range(ticks):
        _hold(rig, 0.010 - (0.010 - down_to_m) * min(1.0, 2.0 * k / ticks), 1)


def test_free_tools_feel_nothing(rig: Rig) -> None:
    for _ in range(20):
        rig.turn(FAR, FAR)
    model = rig.model()
    assert model.force_n == (0.0, 0.0, 0.0)
    assert not model.in_contact


def test_pressing_the_wall_pushes_back(rig: Rig) -> None:
    """The force grows with depth and lifts the tool; K lies between the static slope and the coupling's spring.

    K is what the hand meets over some ticks, when inertia still holds some of the wall: at least the slope of settled
    forces.
    """
    _press(rig, 200)
    forces = []
    for height in (0.0060, 0.0056):
        _hold(rig, height, 400)
        forces.append(rig.physics.simulation.tool_results.force_n[0].copy())
    assert 0.0 < forces[0][2] < forces[1][2]
    model = rig.model()
    K = np.array(model.stiffness_n_m).reshape(3, 3)
    symmetric = np.linalg.eigvalsh(0.5 * (K + K.T))
    coupling = rig.physics.simulation.scene.forceps[0].coupling_stiffness_n_m
    assert model.in_contact
    assert symmetric.min() > -1e-9 * coupling
    assert symmetric.max() <= coupling * (1.0 + 1e-9)
    assert K[2, 2] >= 0.9 * (forces[1][2] - forces[0][2]) / 0.0004


def test_a_hand_that_presses_while_physics_begins_anew_feels_the_duct_once_it_has_lifted(rig: Rig) -> None:
    """A duct that is round again is where the tool is: pushed out of it, jaws would be wedged for good."""
    _press(rig, 200, 0.005)
    felt_n = rig.model().force_n[2]
    rig.physics._begin()
    for _ in range(200):
        _hold(rig, 0.005, 1)
        assert rig.physics.simulation.tool_results.force_n[0].tolist() == [0.0, 0.0, 0.0]
        assert rig.physics.simulation.tool_results.grasp_torque_nm[0] == 0.0
    _press(rig, 200, 0.005)
    assert rig.model().force_n[2] == pytest.approx(felt_n, rel=0.05)


def test_what_finds_no_room_is_told(in_memory: type[Rig]) -> None:
    """In health's gauges, from where metrics and the dashboard have it; nothing where there is room."""
    told = {}
    for capacity in (96, 3, 1):
        rig = in_memory(f"contact.capacity={capacity}")
        _press(rig, 60)
        for process in (rig.haptics_process, rig.physics_process):
            told[process.name, capacity] = report_of(process.health).gauges
    assert told["haptics", 96]["dropped_pairs"] == told["physics", 96]["dropped_pairs"] == 0.0
    assert told["physics", 96]["dropped_contacts"] == told["physics", 96]["dropped_holds"] == 0.0
    assert told["physics", 96]["refused_inputs"] == 0.0
    assert told["physics", 3]["dropped_contacts"] > 0.0
    assert told["physics", 96]["withheld_s"] == told["physics", 3]["withheld_s"] == 0.0
    assert told["physics", 1]["withheld_s"] > 0.01  # one row bears no hand that presses: its motion gives way


def test_the_model_leaves_first_and_it_alone_does_not_wait_for_the_end_of_the_tick(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[tuple[str, bool]] = []
    for bus in (rig.haptics_process.bus, rig.physics_process.bus):

        def publish(name: str, *_body: object, at_once: bool = False, of: MemoryBus = bus, **said: object) -> int:
            sent.append((name, at_once))
            return MemoryBus.publish(of, name, *_body, **said)  # type: ignore[arg-type]

        monkeypatch.setattr(bus, "publish", publish)
    rig.turn(FAR, FAR)
    assert sent == [("haptics.contact_model", True), ("haptics.contacts", False), ("physics.state", False)]


def test_when_physics_falls_silent_no_force_is_known(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    _press(rig, 100)
    assert rig.model().in_contact
    now_ns = time.monotonic_ns
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns() + round(1e9 * STALE_S))
    state = GatewayState(tick=rig.tick, instruments=(InstrumentState(name="0", position_m=(0.02, 0.0, 0.006)),))
    rig.gateway.publish("gateway.state", state)
    frame = rig.haptics_process.bus.latest("gateway.state")
    assert frame is not None
    rig.haptics.answer(frame)
    answer = rig.gateway.latest("haptics.contact_model")
    assert answer is not None
    assert not answer.valid
    assert not answer.body.local_models()[0].in_contact


def test_a_frame_with_a_grasp_of_what_is_not_there_is_refused_whole(rig: Rig) -> None:
    """Kernels trust indices: one that is out of range must never reach them."""
    reader = ContactsReader(rig.physics.simulation)
    spy = type(rig.gateway)(rig.hub, reads=["haptics.contacts"])
    rig.turn((0.02, 0.0, 0.006), FAR)
    frame = spy.latest("haptics.contacts")
    assert frame is not None
    hold = HeldPoint(
        hold_id=1, tool=0, target_kind=1, target=19, target_weights=(1.0, 0.0, 0.0), limit_n=1.0, jaw_angle_rad=0.1
    )
    good = msgspec.structs.replace(frame.body, holds=(hold,))
    assert reader.read_contacts(good)
    n_triangles = len(rig.physics.simulation.duct.reduced.mesh.triangles)
    wrong = {"target": 20}, {"tool": 5}, {"target_kind": 0, "target": n_triangles}
    for changes in wrong:
        holds = (msgspec.structs.replace(hold, **changes),)
        assert not reader.read_contacts(msgspec.structs.replace(good, tools=tool_table(()), holds=holds))
        assert reader.tools.present.tolist() == [True, True]
        assert [each.target for each in reader.tools.holds or ()] == [19]
    assert reader.refused == len(wrong)


def test_the_same_frames_give_the_same_physics(rig: Rig) -> None:
    """Bit for bit, however late each frame was: what the hands did decides, not when."""
    spy = type(rig.gateway)(rig.hub, reads_every=["haptics.contacts"])
    _press(rig, 80)
    frames = spy.drain("haptics.contacts")
    states = []
    for _ in range(2):
        rig.physics._begin()
        for frame in frames:
            rig.physics.advance(frame, 1)
        states.append(
            (rig.physics.simulation.duct.state.q.copy(), rig.physics.simulation.catheter.state.position_m.copy())
        )
    np.testing.assert_array_equal(states[0][0], states[1][0])
    np.testing.assert_array_equal(states[0][1], states[1][1])


def test_a_state_that_is_no_number_is_written_down_and_replaced(
    rig: Rig, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    _press(rig, 40)
    simulation = rig.physics.simulation
    step = simulation.step

    def diverge(*arguments: object) -> None:
        step(*arguments)  # type: ignore[arg-type]
        simulation.duct.state.q[3] = np.nan

    monkeypatch.setattr(simulation, "step", diverge)
    spy = type(rig.gateway)(rig.hub, reads=["physics.state"])
    rig.turn(FAR, FAR)
    assert rig.physics.resets == 1
    assert "not a number" in caplog.text
    answer = spy.latest("physics.state")
    assert answer is not None
    assert not answer.valid
    rig.turn(FAR, FAR)
    assert rig.physics.resets == 1
    assert np.isfinite(rig.physics.simulation.duct.state.q).all()


def test_frames_that_do_not_fit_the_scene_are_refused(rig: Rig) -> None:
    for _ in range(3):
        rig.turn(FAR, FAR)
    scene = rig.haptics.grasping.scene
    spy = type(rig.gateway)(rig.hub, reads=["physics.state"])
    rig.turn(FAR, FAR)
    frame = spy.latest("physics.state")
    assert frame is not None
    duct, catheter = frame.body.duct, frame.body.catheter
    for body in (
        msgspec.structs.replace(duct, basis_hash="another"),
        msgspec.structs.replace(duct, q=pack(np.zeros(3)), q_rate=pack(np.zeros(3))),
        msgspec.structs.replace(duct, load_node=pack([10**6], "<i4"), load_force_n=pack(np.zeros((1, 3)))),
        msgspec.structs.replace(duct, load_node=pack([-1], "<i4"), load_force_n=pack(np.zeros((1, 3)))),
    ):
        scene.take_duct(body)
    few = msgspec.structs.replace(catheter, position_m=pack(np.zeros((4, 3))), velocity_m_s=pack(np.zeros((4, 3))))
    scene.take_catheter(few)
    assert scene.refused == {"basis": 2, "load_node": 2, "particles": 1}


def test_on_a_rung_with_long_steps_physics_answers_every_second_tick_and_loses_none(
    in_memory: type[Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = in_memory("quality=[{name: full}, {name: long steps, ticks_per_step: 2}]")
    lengths_s: list[float] = []
    step = rig.physics.simulation.step

    def watched(tools: ToolInputs, dt_s: float) -> None:
        lengths_s.append(dt_s)
        step(tools, dt_s)

    asked: list[int] = []
    advance = rig.physics.advance

    def told(frame: Frame, ticks: int) -> None:
        asked.append(ticks)
        advance(frame, ticks)

    monkeypatch.setattr(rig.physics, "advance", told)
    monkeypatch.setattr(rig.physics.simulation, "step", watched)
    frames = []
    for level, ticks in ((0, 4), (1, 40), (0, 4)):
        rig.physics.obey(level)
        before = len(lengths_s), len(asked)
        _hold(rig, 0.02, ticks)
        frames.append((len(lengths_s) - before[0], len(asked) - before[1]))
    assert frames[0] == (4, 4)
    assert frames[1] == (20, 21)  # haptics hears of it with the first answer, and then asks every second tick
    assert set(lengths_s) == {1e-3, 2e-3}
    assert sum(lengths_s) == pytest.approx(1e-3 * rig.tick)
    assert rig.meter.misses <= 1  # none but where it goes back to short steps


def test_a_tick_that_is_lost_changes_no_step_s_length(in_memory: type[Rig], monkeypatch: pytest.MonkeyPatch) -> None:
    """What contacts keep for one length is made anew for another: a lost tick made the steps after it late as well."""
    rig = in_memory("quality=[{name: full}, {name: long steps, ticks_per_step: 2}]")
    rig.physics.obey(1)
    _hold(rig, 0.02, 10)
    lengths_s: list[float] = []
    step = rig.physics.simulation.step

    def watched(tools: ToolInputs, dt_s: float) -> None:
        lengths_s.append(dt_s)
        step(tools, dt_s)

    monkeypatch.setattr(rig.physics.simulation, "step", watched)
    began = rig.tick
    for lost, then in ((1, 10), (1, 11), (3, 10), (1, 10), (0, 10)):
        rig.tick += lost
        _hold(rig, 0.02, then)
    assert set(lengths_s) == {2e-3}
    assert sum(lengths_s) == pytest.approx(1e-3 * (rig.tick - began), abs=2.1e-3)
    rig.physics.obey(0)
    _hold(rig, 0.02, 3)
    assert set(lengths_s) == {1e-3, 2e-3}


def test_haptics_has_a_whole_step_for_what_physics_waits_for_and_a_tick_for_the_hand(in_memory: type[Rig]) -> None:
    rig = in_memory("quality=[{name: full}, {name: long steps, ticks_per_step: 2}]")
    allowed = []
    for level, ticks in ((0, 3), (1, 7), (0, 3)):
        rig.physics.obey(level)
        for _ in range(ticks):
            _hold(rig, 0.02, 1)
            allowed.append(rig.haptics_meter.periods_allowed)
    assert allowed[:3] == [1, 1, 1]
    assert allowed[6:10] == [2, 1, 2, 1]
    assert allowed[-2:] == [1, 1]


def test_what_is_pressed_at_rest_feels_the_same_with_long_steps(in_memory: type[Rig]) -> None:
    rig = in_memory("quality=[{name: full}, {name: long steps, ticks_per_step: 2}]")
    _press(rig, 400)
    _hold(rig, 0.006, 400)
    force_n = np.array(rig.model().force_n)
    assert force_n[2] > 0.02
    for level in (1, 0, 1):
        rig.physics.obey(level)
        for _ in range(51):
            _hold(rig, 0.006, 1)
            assert rig.model().force_n == pytest.approx(force_n, abs=0.01 * np.linalg.norm(force_n))
