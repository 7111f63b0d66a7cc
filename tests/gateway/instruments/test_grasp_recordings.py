"""Real grasps, recorded at 1 kHz, through drive, CAN, gateway and grasp rendering and back to the motor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.gateway.can.virtual_node import VirtualNode
from tests.gateway.instruments.test_instrument import FakeArm
from tests.gateway.kicks import ENDLESS_N
from tests.haptics.models import local_model
from trocar.protocol import Frame, decode, encode, topic
from trocar.protocol.bodies import ContactModel, GatewayState, InstrumentState, LocalModel, ToolReaction
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.recording import read_table
from trocar.services.gateway.instruments import instrument
from trocar.services.gateway.instruments.instrument import Instrument
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.simulated.emulated_drive import ENCODER_COUNTS, Handle
from trocar.services.mechanics.bodies.forceps.kinematics import jaw_angle_from_handle
from trocar.services.mechanics.scene import ForcepsScene
from trocar.services.runtime.config.rig import DriverSettings, InstrumentSettings, Mount

RECORDINGS = Path(__file__).resolve().parents[4] / "shared" / "data" / "grasp"
NAMES = sorted(path.stem for path in RECORDINGS.glob("*.csv")) or ["any"]
TICK_S = 1e-3
TTL_S = 0.02
COUNT_RAD = 2.0 * math.pi / ENCODER_COUNTS
FORCEPS = ForcepsScene(jaw_max_angle_rad=1.2)
#: What is between the jaws: met at an opening, and a spring from there on.
MET_RAD, SPRING_NM_RAD = 0.7, 0.15
#: A float of four bytes, turns to radians.
ROUNDING = 1e-6
SETTLING_TICKS = 400


@dataclass(frozen=True)
class Course:
    """Of every tick (n,): the handle itself, what the gateway said of it, and what its motor did."""

    true_rad: np.ndarray
    said_rad: np.ndarray
    torque_nm: np.ndarray


class HeldHandle(Handle):
    """A handle in a hand so firm that no motor moves it: it is where the hand wants it."""

    def step(self, wanted_rad: float, torque_nm: float, dt_s: float) -> None:
        """Go there."""
        self.rate_rad_s = (wanted_rad - self.angle_rad) / dt_s
        self.angle_rad = wanted_rad


def recording(name: str) -> np.ndarray:
    path = RECORDINGS / f"{name}.csv"
    if not path.is_file():
        pytest.skip(f"there is no recording in {RECORDINGS}")
    return np.asarray(read_table(path, ("handle_angle_rad",))["handle_angle_rad"])


def play(angles: np.ndarray, channel: str, monkeypatch: pytest.MonkeyPatch) -> Course:
    """Move a handle through `angles`, a tick each, with an elastic thing between the jaws."""
    node = VirtualNode(channel, handle=HeldHandle(float(angles[0])))
    bus = {"interface": "virtual", "channel": channel}
    settings = DriverSettings(driver="grasp_odrive_can", device="grasp_odrive", settings={"bus": bus})
    handle = drivers.load_grasp(settings, replace(Place("left", Mount()), clock=node.clock))
    servo = Servo(ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, ENDLESS_N), ramp_s=0.05)
    row = InstrumentSettings(name="left", port_m=(0.0, 0.0, 0.1), arm=DriverSettings(driver="fake"))
    tool = Instrument(row, FakeArm(), handle, servo)
    monkeypatch.setattr(instrument, "time", SimpleNamespace(monotonic_ns=node.clock.monotonic_ns))
    tool.open()
    said, torques = np.empty(len(angles)), np.empty(len(angles))
    for k, angle in enumerate(angles):
        node.wanted_rad = float(angle)
        node.advance()
        now_ns = node.clock.monotonic_ns()
        tool.read(now_ns)
        tool.answer(now_ns)
        heard = over_the_wire(GatewayState(tick=k, instruments=(tool.state(),)), "gateway.state").instruments[0]
        # Force begins where little is asked for: the thing is there once the servo is engaged.
        model = render(heard) if k >= SETTLING_TICKS else _model(ToolReaction(), heard, touching=False)
        answer = over_the_wire(ContactModel.of(k, TTL_S, (model,)), "haptics.contact_model")
        servo.accept(answer.models.view()[0], TTL_S, now_ns, 1)
        tool.exchange_handle()
        said[k] = tool.state().handle_angle_rad
        torques[k] = node.drive.torque_nm
    tool.close()
    node.close()
    return Course(angles, said, torques)


def over_the_wire(body: Any, name: str) -> Any:
    return decode(encode(Frame(1, name, topic(name).version, 1, 1, 1, 1, True, body))).body


def _model(reaction: ToolReaction, state: InstrumentState, *, touching: bool) -> LocalModel:
    return local_model(reaction, state, FORCEPS, touching=touching)


def render(state: InstrumentState) -> LocalModel:
    """Return the model of an elastic thing, as haptics makes it of what physics solved for this opening."""
    opening = jaw_angle_from_handle(state.handle_angle_rad, FORCEPS.jaw_ratio, FORCEPS.jaw_max_angle_rad)
    squeezed = max(0.0, MET_RAD - opening)
    reaction = ToolReaction(
        grasp_torque_nm=SPRING_NM_RAD * squeezed,
        grasp_stiffness_nm_rad=SPRING_NM_RAD if squeezed else 0.0,
        jaw_angle_rad=opening,
        contacts=int(squeezed > 0.0),
    )
    return _model(reaction, state, touching=True)


@pytest.mark.parametrize("name", NAMES)
def test_a_real_grasp_is_measured_and_felt_to_a_count_and_a_tick(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    course = play(recording(name), str(tmp_path), monkeypatch)
    moved = np.abs(np.diff(course.true_rad, prepend=course.true_rad[0]))
    within = COUNT_RAD + moved + ROUNDING
    assert (np.abs(course.said_rad - course.true_rad) <= within).all()
    assert np.ptp(course.said_rad) > 0.9

    settled = slice(SETTLING_TICKS + 100, -1)
    law = SPRING_NM_RAD * np.maximum(0.0, MET_RAD - course.true_rad)
    before = np.append(0.0, moved[:-1])
    damping = FORCEPS.jaw_damping_nm_s_rad * (moved + before) / TICK_S  # by how much the rate differs from the model's
    allowed = SPRING_NM_RAD * (within + before) + damping + ROUNDING  # the model was made a tick before
    answer = np.append(course.torque_nm[1:], 0.0)  # a drive hears at its next tick
    assert (np.abs(answer - law) <= allowed)[settled].all()
    assert course.torque_nm.max() > 0.09
