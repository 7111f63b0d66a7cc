"""One instrument of the rig: its arm, its handle, its servo."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import trocar.protocol.bodies as bodies
from trocar.protocol import Frame
from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.devices.driver import NO_HANDLE, Arm, GraspHandle, Place
from trocar.services.gateway.drivers import load_arm, load_grasp
from trocar.services.gateway.instruments.servo import Servo, ServoLimits, torque_rate
from trocar.services.gateway.motions.scene_hands import SceneHand, fitted
from trocar.services.gateway.servo import pose, servo_arrays
from trocar.services.gateway.servo.engagement import EngagementState
from trocar.services.runtime.config.rig import GatewaySettings, InstrumentSettings

#: After so long without force because the tool pulls at something, a person would move, and the tool touches nothing
#: until it is clear. A hand without force may have led it to where no way back is free.
PATIENCE_S = 2.0
#: Gauge of the longest time from reading a device to writing to it, s.
WRITE_SPAN = "write_span_s"


class Instrument:
    """Once a tick: `read` the arm, `answer` with a force; later in the tick, `exchange_handle`."""

    def __init__(self, settings: InstrumentSettings, arm: Arm, grasp: GraspHandle | None, servo: Servo) -> None:
        self.name = settings.name
        self.arm = arm
        self.grasp = grasp
        self.servo = servo
        self.model_sequence = -1
        self._port = np.array(settings.port_m)
        self._port_m = settings.port_m
        self._mount = pose.pack_mount(settings.mount)
        self._reading = np.zeros(servo_arrays.READ_SIZE)
        self._handle = np.zeros(servo_arrays.HANDLE_SIZE)
        self._pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        self._motion, self._orientation = self._pose[:6], self._pose[6:]
        self._arm_force = np.zeros(3)
        self._torque_nm = 0.0
        self._read_ns = self._wrote_ns = self._turned_ns = 0

    def open(self) -> None:
        """Open the devices, force off."""
        self.arm.open()
        if self.grasp is not None:
            self.grasp.open()
        self.servo.engagement.open(self.arm.calibrated)

    def warm(self) -> None:
        """Run every kernel of a tick once, with force off, so that none is compiled in a tick."""
        self.read(0)
        if self.grasp is not None:  # physics would take a handle that nobody has read for shut
            self.grasp.read(0, self._handle)
        self.servo.step(1, self._motion, 0.0, calibrated=False)
        self.servo.step_grasp(1, self._handle)
        pose.force_to_arm(self.servo.force_n, self._mount, self._arm_force)
        self.servo.reset_clock()
        servo_arrays.are_models(np.zeros((1, MODEL_COLUMNS)))

    def read(self, time_ns: int) -> None:
        """Read the arm."""
        self._read_ns = time.monotonic_ns()
        self.arm.read(time_ns, self._reading)
        pose.place_tool(self._reading, self._mount, self._port, self._motion, self._orientation)

    def answer_pose(self, now_ns: int, others: Sequence[Servo] = ()) -> None:
        """Compute and write the force for the pose read at `now_ns`; switch the motors on when force begins.

        `others` are the servos of all other instruments, which account for energy together.
        """
        servo, arm = self.servo, self.arm
        if arm.fault:
            servo.engagement.fail(arm.fault)
        temperature = float(self._reading[servo_arrays.READ_TEMPERATURE])
        calibrated, law = arm.calibrated, arm.evaluate
        others_j, reserved_j = sum(each.energy_j for each in others), sum(each.reserved_j for each in others)
        if servo.step(
            now_ns, self._motion, temperature, calibrated=calibrated, others_j=others_j, reserved_j=reserved_j, law=law
        ):
            arm.enable()
            if self.grasp is not None:
                self.grasp.enable()
        elif self.is_withdrawn:
            arm.go_on()
            if self.grasp is not None:
                self.grasp.go_on()
        if arm.has_force and not arm.own_servo:
            pose.force_to_arm(servo.force_n, self._mount, self._arm_force)
            arm.write(self._arm_force)
            wrote_ns = time.monotonic_ns()
            span_ns = arm.write_span_ns(self._read_ns, wrote_ns)
            servo.arm_span.note(1e-9 * span_ns, 1e-9 * (wrote_ns - self._wrote_ns), arm.skipped)
            self._wrote_ns = wrote_ns

    @property
    def is_withdrawn(self) -> bool:
        """Whether the tool is to touch nothing, as what it touches has prevented force for `PATIENCE_S`."""
        return self.servo.engagement.refused_s > PATIENCE_S

    def exchange_handle(self, time_ns: int | None = None) -> None:
        """Read the handle and write its torque, at a time of the rig where that is simulated."""
        grasp = self.grasp
        if grasp is None:
            return
        now_ns = time.monotonic_ns() if time_ns is None else time_ns
        grasp.read(now_ns, self._handle)
        servo = self.servo
        servo.grasp_on = grasp.ready
        servo.step_grasp(now_ns, self._handle)
        self._torque_nm = servo.torque_nm
        grasp.write(self._torque_nm)
        wrote_ns = time.monotonic_ns() if time_ns is None else time_ns
        servo.handle_span.note(1e-9 * (wrote_ns - now_ns), 1e-9 * (wrote_ns - self._turned_ns))
        self._turned_ns = wrote_ns

    def rearm(self) -> None:
        """Clear faults, as a person has armed the rig."""
        self.arm.clear_fault()
        if self.grasp is not None:
            self.grasp.clear_fault()
        self.servo.engagement.arm()

    def try_again(self) -> None:
        """Retry devices with a fault; all others keep their force."""
        engagement = self.servo.engagement
        if engagement.fault or self.arm.fault or self.arm.prompt:
            self.arm.clear_fault()
            engagement.arm()
        if self.grasp is not None and (self.grasp.fault or self.grasp.prompt):
            self.grasp.clear_fault()

    def begin_again(self) -> None:
        """Reset simulated hands to their start, while no force is on."""
        self.arm.begin_again()
        if self.grasp is not None:
            self.grasp.begin_again()

    def keep_pace(self, pace: float) -> None:
        """Set the pace of simulated hands to that of the rig's time."""
        if self.grasp is not None:
            self.grasp.keep_pace(pace)

    def close(self) -> None:
        """Set zero force and torque."""
        self.arm.close()
        if self.grasp is not None:
            self.grasp.close()
        self.servo.engagement.state = EngagementState.OFF

    @property
    def fault(self) -> str:
        """The fault that restricts the instrument, or empty."""
        own = self.servo.engagement.fault or self.arm.prompt
        return own if own or self.grasp is None else self.grasp.fault or self.grasp.prompt

    def links(self) -> dict[str, float]:
        """Return whether the arm is calibrated, by device whether it answers, and its gauges, for the health report."""
        found = {f"arm_calibrated.{self.name}": float(self.arm.calibrated and not self.arm.fault)}
        for kind, device in (("arm", self.arm), ("grasp", self.grasp)):
            if device is not None:
                found[f"device_link_up.{self.name}.{kind}"] = float(not device.fault)
                found.update({f"{name}.{self.name}.{kind}": value for name, value in device.gauges().items()})
        if self.arm.has_force and not self.arm.own_servo:
            found[f"{WRITE_SPAN}.{self.name}.arm"] = self.servo.arm_span.longest_s
        if self.grasp is not None and self.grasp.has_force:
            found[f"{WRITE_SPAN}.{self.name}.grasp"] = self.servo.handle_span.longest_s
        return found

    def state(self) -> bodies.InstrumentState:
        """Return the instrument's part of this tick's device frame."""
        x, y, z, vx, vy, vz, qw, qx, qy, qz = self._pose.tolist()
        angle, rate = self._handle.tolist()
        temperature, roll = self._reading[servo_arrays.READ_TEMPERATURE :].tolist()
        servo = self.servo
        fx, fy, fz = servo.force_n.tolist()
        return bodies.InstrumentState(
            name=self.name,
            position_m=(x, y, z),
            orientation_wxyz=(qw, qx, qy, qz),
            velocity_m_s=(vx, vy, vz),
            handle_angle_rad=angle,
            handle_rate_rad_s=rate,
            buttons=self.arm.buttons,
            port_m=self._port_m,
            applied_force_n=(fx, fy, fz),
            applied_grasp_torque_nm=self._torque_nm,
            state=servo.engagement.state.value,
            force_scale=servo.scale,
            model_sequence=self.model_sequence,
            model_age_s=servo.age_s if self.model_sequence >= 0 else -1.0,
            motor_temperature=temperature,
            has_force=self.arm.has_force,
            fault=self.fault[:256],
            roll_rad=roll,
        )


def build_instruments(
    settings: GatewaySettings,
    newest: Callable[[str], Frame | None] = lambda _topic: None,
    hands: Sequence[SceneHand] = (),
) -> list[Instrument]:
    """Return the instruments of a rig file, with devices not yet open.

    `newest` is as in `Place`; `hands` are the motions of the scene's hands.
    """
    held = [*hands, *(None for _ in settings.instruments)]
    return [_build(settings, row, index, newest, held[index]) for index, row in enumerate(settings.instruments)]


def _build(
    settings: GatewaySettings,
    row: InstrumentSettings,
    index: int,
    newest: Callable[[str], Frame | None],
    hand: SceneHand | None,
) -> Instrument:
    row = fitted(row, hand)
    place = Place(
        row.name,
        row.mount,
        row.port_m,
        index,
        force_rate_n_s=settings.force_rate_limit_n_s,
        newest=newest,
        motion=None if hand is None else hand.motion,
    )
    arm = load_arm(row.arm, place)
    force_n, torque_nm = min(settings.force_limit_n, arm.limits.max_force_n), settings.grasp_torque_limit_nm
    place = replace(place, torque_rate_nm_s=torque_rate(torque_nm, settings.force_rate_limit_n_s, force_n))
    grasp = load_grasp(row.grasp, place) if row.grasp is not None else None
    limits = ServoLimits(
        force_n=force_n,
        continuous_force_n=arm.limits.continuous_force_n,
        force_rate_n_s=settings.force_rate_limit_n_s,
        torque_nm=torque_nm if grasp is None else min(torque_nm, grasp.max_torque_nm),
        velocity_m_s=arm.limits.max_velocity_m_s,
        count_m=arm.limits.count_m,
        friction_n=arm.limits.friction_n,
        delay_s=arm.limits.delay_s,
        handle=NO_HANDLE if grasp is None else grasp.limits,
    )
    return Instrument(row, arm, grasp, Servo(limits, settings.engage_ramp_s))
