"""Everything that may go wrong before the servo, one after another: what the hand and the handle feel of it.

Arms of the vendor's library have drills of their own: `test_hdapi_faults`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from tests.by_day import by_day
from tests.gateway.drill_bench import (
    ENDS_S,
    LIMIT_N,
    RATE_N_S,
    TICK_NS,
    TORQUE_NM,
    TTL_S,
    Drill,
    Haptics,
    Message,
    Moment,
    Stream,
    at_once,
)
from tests.gateway.kicks import kicks_n
from trocar.protocol import topic
from trocar.protocol.bodies import ContactModel, SupervisorState
from trocar.services.gateway import __main__ as gateway_process
from trocar.services.gateway.can import cansimple
from trocar.services.gateway.can.cansimple import AxisError
from trocar.services.runtime.bus import bus

PRESSES_S, WRONG_S = 0.75, 0.4
TTL_TICKS = round(TTL_S * 1e9) // TICK_NS
TORQUE_NM_S = TORQUE_NM * RATE_N_S / LIMIT_N
ROUNDING = 1e-9


@pytest.fixture
def drill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Drill]:
    """Return a hand that presses a wall and a handle that squeezes, both with force."""
    bench = Drill(tmp_path, monkeypatch)
    pressing = bench.run(PRESSES_S)[-1]
    assert np.linalg.norm(pressing.state.applied_force_n) > 0.5
    assert pressing.applied_nm > 0.02
    yield bench
    bench.close()


def changed(**fields: Any) -> Stream:
    """Return a stream whose models differ in some fields."""

    def stream(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
        models = [_with(model, fields) for model in body.local_models()]
        return at_once(haptics, ContactModel.of(body.tick, body.ttl_s, models), origin_ns)

    return stream


def _with(body: Any, fields: dict[str, Any]) -> Any:
    return type(body)(**({name: getattr(body, name) for name in body.__struct_fields__} | fields))


def silent(_haptics: Haptics, _body: ContactModel, _origin_ns: int) -> list[Message]:
    return []


def late(ticks: int) -> Stream:
    return lambda haptics, body, origin_ns: [(ticks, haptics.seal(body, origin_ns))]


def reordered(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    return [(2 if body.tick % 2 else 0, haptics.seal(body, origin_ns))]


def duplicated(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    data = haptics.seal(body, origin_ns)
    return [(0, data), (0, data), (1, data), (7, data)]


class Stale:
    """Says what it said first again and again, in new frames."""

    def __init__(self) -> None:
        self._first: tuple[ContactModel, int] | None = None

    def __call__(self, haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
        self._first = self._first or (body, origin_ns)
        return at_once(haptics, *self._first)


def invalid(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    return [(0, haptics.seal(body, origin_ns, valid=False))]


def torn(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    data = haptics.seal(body, origin_ns)
    return [(0, data[: len(data) // 2])]


def answers_what_nobody_asked(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    return at_once(haptics, _with(body, {"tick": body.tick + 1000}), origin_ns)


def for_another_rig(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    return at_once(haptics, ContactModel.of(body.tick, body.ttl_s, 2 * body.local_models()), origin_ns)


NAN, INFINITE = (0.0, 0.0, math.nan), (0.0, math.inf, 0.0)
HUGE9 = (1e12,) + (0.0,) * 3 + (1e12,) + (0.0,) * 3 + (1e12,)
#: What comes instead of models in time; whether force must fade for it.
STREAMS: dict[str, tuple[Callable[[], Stream], bool]] = {
    "killed": (lambda: silent, True),
    "delayed by 5 ms": (lambda: late(5), False),
    "delayed by 20 ms": (lambda: late(20), True),
    "delayed by 100 ms": (lambda: late(100), True),
    "reordered": (lambda: reordered, False),
    "duplicated": (lambda: duplicated, False),
    "force is NaN": (lambda: changed(force_n=NAN), True),
    "force is infinite": (lambda: changed(force_n=INFINITE), True),
    "torque is NaN": (lambda: changed(grasp_torque_nm=math.nan), True),
    "stiffness is NaN": (lambda: changed(stiffness_n_m=(math.nan,) * 9), True),
    "huge force": (lambda: changed(force_n=(1e9, -1e9, 1e9), grasp_torque_nm=1e9), False),
    "huge stiffness": (lambda: changed(stiffness_n_m=HUGE9, grasp_stiffness_nm_rad=1e12), False),
    "huge damping": (lambda: changed(damping_n_s_m=HUGE9, grasp_damping_nm_s_rad=1e12), False),
    "largest numbers": (lambda: changed(force_n=(1e308,) * 3, stiffness_n_m=(1e308,) * 9), False),
    "stale": (Stale, True),
    "invalid": (lambda: invalid, True),
    "torn": (lambda: torn, True),
    "answers what nobody asked": (lambda: answers_what_nobody_asked, True),
    "for another rig": (lambda: for_another_rig, True),
}


#: By day one of those that are refused alike; haptics starts anew after what leaves the hand limp, pushes or is late.
ALIKE = "delayed by 20 ms", "force is infinite", "torque is NaN", "huge stiffness", "invalid", "for another rig"
ANEW = "killed", "huge force", "delayed by 5 ms", "stale"
CASES = [(what, restarts) for restarts in (False, True) for what in STREAMS]
BY_DAY = [(what, restarts) for what, restarts in CASES if what in ANEW or not (restarts or what in ALIKE)]


@pytest.mark.parametrize(("what", "restarts"), by_day(BY_DAY, [case for case in CASES if case not in BY_DAY]))
def test_whatever_comes_instead_of_models_the_hand_is_safe(drill: Drill, what: str, restarts: bool) -> None:
    make, fades = STREAMS[what]
    wrong = drill.run(WRONG_S, make())
    if fades:
        assert limp(wrong[TTL_TICKS + 1 :])
        assert wrong[-1].state.state == "stale"
    else:
        assert {moment.state.state for moment in wrong} == {"active"}
    if restarts:
        drill.haptics.restart()
    drill.run(ENDS_S - PRESSES_S - WRONG_S)
    assert drill.moments[-1].state.state == "active", "force comes back where nothing is asked for"
    never_a_kick(drill.moments)
    assert drill.books.close().gained_j <= 0.0


def limp(moments: list[Moment]) -> bool:
    """Return whether neither force nor torque is on."""
    return not any(any(m.state.applied_force_n) or m.applied_nm for m in moments)


def never_a_kick(moments: list[Moment]) -> None:
    """No step above the rate limits, nothing above the limits, never more than can be taken back in a model's life.

    A tick that comes late finds more force than it would have left; the next ones take it back.
    """
    forces = np.array([moment.state.applied_force_n for moment in moments])
    written = np.linalg.norm(forces, axis=1)
    passed_s = np.diff([moment.now_ns for moment in moments]) * 1e-9
    assert (kicks_n(forces) <= RATE_N_S * np.minimum(passed_s, 0.003) + ROUNDING).all()
    assert written.max() <= LIMIT_N + ROUNDING
    ages_s = np.array([moment.state.model_age_s for moment in moments])
    bound = RATE_N_S * np.maximum(0.0, TTL_S - ages_s) + ROUNDING
    had = np.append(written[0], written[:-1])
    assert (written <= np.maximum(bound, had - RATE_N_S * 1e-3 + ROUNDING)).all()
    torques = np.array([moment.state.applied_grasp_torque_nm for moment in moments])
    # A handle waits two ticks for a haptics that is late, and then has a step for all three.
    assert (np.abs(np.diff(torques)) <= TORQUE_NM_S * 0.003 + ROUNDING).all()
    assert (np.abs(torques[10:] - torques[:-10]) <= TORQUE_NM_S * 0.012 + ROUNDING).all()
    assert np.abs(torques).max() <= TORQUE_NM + ROUNDING


def dead(drill: Drill) -> None:
    drill.clock.node_lives = False


def without(command: int) -> Callable[[Drill], None]:
    return lambda drill: drill.node.unsaid.add(command)


def deaf(drill: Drill) -> None:
    """Its watchdog lets go, and that is latched."""
    drill.node.hearing = False


def stopped_by_hand(drill: Drill) -> None:
    drill.node.drive.receive(cansimple.identifier(1, cansimple.ESTOP), b"", False, 0.0)


def bus_off(drill: Drill) -> None:
    """An adapter that has left the bus refuses to send and to receive."""
    link = drill.grasp._link
    assert link is not None
    link.bus = BusOff()


class BusOff(can.BusABC):  # type: ignore[misc]
    def __init__(self) -> None:
        super().__init__(channel="off")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("bus-off")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        raise can.CanOperationError("bus-off")


@dataclass(frozen=True)
class DriveFault:
    """What goes wrong with a drive, after how many ticks its torque is gone, and what is said of it."""

    begin: Callable[[Drill], None]
    limp_after: int
    fault: str


#: An estimate may be 5 ms old, a heartbeat 0.3 s, the drive's watchdog waits 50 ms; then a model's life for the fade.
DRIVES = {
    "dead drive": DriveFault(dead, 5 + TTL_TICKS, "silent for 0.3 s"),
    "lost heartbeat": DriveFault(without(cansimple.HEARTBEAT), 300 + TTL_TICKS, "silent for 0.3 s"),
    "lost estimates": DriveFault(without(cansimple.GET_ENCODER_ESTIMATES), 5 + TTL_TICKS, ""),
    "latched watchdog": DriveFault(deaf, 50 + 100 + TTL_TICKS, "let go: WATCHDOG_TIMER_EXPIRED"),
    "e-stop": DriveFault(stopped_by_hand, 100 + TTL_TICKS, "let go: ESTOP_REQUESTED"),
    "bus-off": DriveFault(bus_off, 5 + TTL_TICKS, "CAN: bus-off"),
}


@pytest.mark.parametrize("what", DRIVES)
def test_a_drive_that_fails_takes_its_torque_and_nothing_else(drill: Drill, what: str) -> None:
    fault = DRIVES[what]
    fault.begin(drill)
    wrong = drill.run(WRONG_S)
    asked = [moment.state.applied_grasp_torque_nm for moment in wrong]
    assert not any(asked[fault.limp_after :]), "no torque is asked of a drive of which nothing is known"
    assert fault.fault in wrong[-1].state.fault
    assert {moment.state.state for moment in wrong} == {"active"}
    assert np.linalg.norm([moment.state.applied_force_n for moment in wrong], axis=1).min() > 0.3, "the arm goes on"
    never_a_kick(drill.moments)
    drill.run(ENDS_S - PRESSES_S - WRONG_S)
    assert drill.books.close().gained_j <= 0.0


def test_what_was_latched_in_a_drive_stays_without_torque_until_the_rig_is_armed(drill: Drill) -> None:
    drill.node.hearing = False
    drill.run(0.1)
    drill.node.hearing = True
    after = drill.run(WRONG_S)
    assert drill.node.drive.errors == AxisError.WATCHDOG_TIMER_EXPIRED
    assert limp([replace_force(moment) for moment in after])
    drill.tool.rearm()
    assert drill.run(1.0)[-1].applied_nm > 0.02
    never_a_kick(drill.moments)


def replace_force(moment: Moment) -> Moment:
    state = _with(moment.state, {"applied_force_n": (0.0, 0.0, 0.0)})
    return replace(moment, state=state)


def test_a_drive_that_comes_back_gets_its_torque_by_a_ramp(drill: Drill) -> None:
    drill.node.unsaid.add(cansimple.GET_ENCODER_ESTIMATES)
    assert drill.run(0.1)[-1].state.applied_grasp_torque_nm == 0.0
    drill.node.unsaid.clear()
    torques = [moment.state.applied_grasp_torque_nm for moment in drill.run(0.3)]
    assert torques[-1] > 0.02
    assert max(np.diff(torques)) < 1.5 * torques[-1] * TICK_NS * 1e-9 / 0.1, "within the 0.1 s of an engagement"


def test_an_adapter_that_is_plugged_in_again_gets_its_torque_by_a_ramp_once_the_rig_is_armed(drill: Drill) -> None:
    bus_off(drill)
    drill.run(WRONG_S)
    drill.tool.rearm()
    while drill.grasp.is_opening:  # in a time that is none of the drill's
        time.sleep(1e-3)
    torques = [moment.state.applied_grasp_torque_nm for moment in drill.run(1.0)]
    assert drill.grasp.fault == ""
    assert torques[-1] > 0.02
    assert max(np.diff(torques)) < 1.5 * max(torques) * TICK_NS * 1e-9 / 0.1, "within the 0.1 s of an engagement"
    never_a_kick(drill.moments)
    drill.run(ENDS_S - PRESSES_S - WRONG_S - 1.0)
    assert drill.books.close().gained_j <= 0.0


@pytest.mark.parametrize("lives", [True, False], ids=["drive goes on", "drive is dead"])
@pytest.mark.parametrize("frames", [512, 3000])
def test_a_backlog_of_old_frames_is_never_applied(drill: Drill, frames: int, lives: bool) -> None:
    """The handle has moved while the gateway was held up: what it said meanwhile is not where it is."""
    before_rad = drill.moments[-1].state.handle_angle_rad
    drill.node.wanted_rad = 0.1
    drill.stall(frames * TICK_NS * 1e-9 / 2)
    drill.node.wanted_rad = 0.9
    drill.stall(frames * TICK_NS * 1e-9 / 2)
    drill.clock.node_lives = lives
    after = drill.run(WRONG_S)
    now_rad = drill.node.drive.handle.angle_rad
    for moment in after:
        angle = moment.state.handle_angle_rad
        assert min(abs(angle - before_rad), abs(angle - now_rad)) < 0.01
    if not lives:
        assert after[-1].state.handle_angle_rad == before_rad
    assert not any(moment.state.applied_grasp_torque_nm for moment in after[TTL_TICKS:])
    never_a_kick(drill.moments)


def test_an_arm_that_fails_is_limp_within_a_models_life_and_the_handle_goes_with_it(drill: Drill) -> None:
    drill.arm.fault = "unplugged"
    wrong = drill.run(WRONG_S)
    assert limp(wrong[TTL_TICKS + 1 :])
    assert (wrong[-1].state.state, wrong[-1].state.fault) == ("fault", "unplugged")
    drill.arm.fault = ""
    assert limp(drill.run(0.3)), "not by itself"
    drill.tool.rearm()
    drill.run(ENDS_S - PRESSES_S - WRONG_S)
    assert drill.moments[-1].state.state == "active"
    never_a_kick(drill.moments)
    assert drill.books.close().gained_j <= 0.0


def test_a_gateway_that_was_held_up_does_not_go_on_where_it_was(drill: Drill) -> None:
    """Half a second without a tick: every model is old, and force begins anew."""
    drill.stall(0.5)
    after = drill.run(0.1)
    assert limp(after[TTL_TICKS:])
    never_a_kick(drill.moments)


def test_while_the_rig_starts_its_time_stands_the_hand_is_limp_and_ticks_are_fewer(drill: Drill) -> None:
    """The loops took half of what others need to be ready; a start in containers took 17 s, and 11 so."""
    supervisor = bus.Outbox(topic("supervisor.state"), bus.new_incarnation())

    def say(state: str) -> None:
        body = SupervisorState(state=state)
        drill.haptics.hub.send("supervisor.state", supervisor.seal(body, drill.clock.now_ns, True))

    say("starting")
    stands = drill.run(0.3)
    assert drill.gateway.meter.rate_hz == gateway_process.STARTING_HZ
    assert topic("gateway.state").stale_after_s > 1.0 / gateway_process.STARTING_HZ
    assert not np.any(stands[-1].state.applied_force_n)
    assert np.ptp([moment.state.position_m for moment in stands[-100:]], axis=0).max() == 0.0
    say("running")
    goes = drill.run(0.3)
    assert drill.gateway.meter.rate_hz == gateway_process.RATE_HZ
    assert np.ptp([moment.state.position_m for moment in goes], axis=0).max() > 1e-3
