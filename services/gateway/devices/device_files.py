"""The files of configs/devices: a device's limits as data. Simulated and real drivers read the same file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.services.gateway.devices.driver import ArmLimits
from trocar.services.runtime.config.bounds import Torque, between
from trocar.services.runtime.config.rig import Settings

_FORCE = between(0.01, 50.0, "N", "the strongest arm for a hand, a Premium High Force, gives 37.5 N")
_CURRENT = between(0.01, 40.0, "A", "an ODrive S1 bears no more for long, and no motor turns with less")
_A_BLINK = between(1e-3, 1.0, "s", "a drive that is silent for longer would go on pushing; a tick takes 0.001 s")
_COUNT = between(1e-8, 2e-4, "m", "no encoder of an arm is finer, and a coarser one is felt as grain")
_FRICTION = between(1e-4, 2.0, "N", "every arm has some, and more would hide all forces")
_SHARE = between(0.0, 1.0, "", "an arm has some part of its friction, and no more than all")
_DELAY = between(0.0, 3e-3, "s", "a force that comes later than three ticks of 1 ms gives energy that no books cover")
_DRY_NM = between(1e-6, 1.0, "N m", "every handle has some, and more would hide all torques")
_COUNT_RAD = between(1e-7, 0.1, "rad", "no encoder of a handle is finer, and a coarser one is felt as grain")
_NYQUIST = between(1.0, 499.0, "Hz", "a velocity is known up to half of the rate of 1 kHz, and has to follow a hand")
_GEAR = between(0.01, 1000.0, "", "a handle's gear lies between")
_TURNS = between(-1000.0, 1000.0, "turns", "a handle goes through no more turns of its motor")
_SPEED = between(0.01, 1000.0, "turns/s", "no motor of a handle is faster, and with less a handle stands")
_OFFSET = Annotated[float, between(-1.0, 1.0, "m", "the workspace of the largest arm, a Premium 3.0, is 0.84 m wide")]


#: Share of a friction told that is relied on if a file does not tell it: what it costs was measured
#: (docs/results/haptics.md).
SURE_FRICTION = 0.25


class ArmFile(Settings):
    """A force-feedback arm."""

    kind: Literal["arm"]
    model: str
    max_force_n: Annotated[float, _FORCE]
    continuous_force_n: Annotated[float, _FORCE]
    max_velocity_m_s: Annotated[float, between(1e-3, 100.0, "m/s", "no hand moves so fast, and every arm has to move")]
    count_m: Annotated[float, _COUNT] = Field(
        description="motion of the tip per encoder count: a smaller motion of a hand is not seen"
    )
    friction_n: Annotated[float, _FRICTION] = Field(
        description="friction at the tip, motors off, as the vendor tells it or as it was measured"
    )
    sure_friction: Annotated[float, _SHARE] = Field(
        SURE_FRICTION,
        description="share of it that this arm surely has: smaller forces give a hand no energy, and have no bound",
    )
    interface_delay_s: Annotated[float, _DELAY] = Field(
        1e-3,
        description="longest time that the interface adds from a motion to the force that answers it, beside the "
        "measured time from reading to writing",
    )
    max_damping_n_s_m: Annotated[float, between(0.0, 1000.0, "N s/m", "no arm is damped more")] | None = Field(
        None, description="has no effect; older files name it"
    )
    velocity_filter_hz: Annotated[float, _NYQUIST] = 100.0
    openhaptics_centre_m: tuple[_OFFSET, _OFFSET, _OFFSET] = Field(
        (0.0, 0.0, 0.0), description="middle of the workspace as OpenHaptics counts: right, up, toward the user"
    )
    device_centre_m: tuple[_OFFSET, _OFFSET, _OFFSET] = Field(
        (0.0, 0.0, 0.0),
        description="middle of the workspace in the axes of Haply's service or Force Dimension's library",
    )

    def limits(self) -> ArmLimits:
        """Return the limits for the servo."""
        count_m, friction_n, _ = self.own()
        most = self.max_force_n, self.continuous_force_n, self.max_velocity_m_s
        return ArmLimits(*most, count_m, friction_n, self.interface_delay_s)

    def own(self) -> tuple[float, float, float]:
        """Return count, sure friction, and no sudden change beyond those seen, for the energy bound."""
        return self.count_m, self.sure_friction * self.friction_n, 0.0


class GraspFile(Settings):
    """A handle on a motor drive."""

    kind: Literal["grasp"]
    model: str
    max_torque_nm: Torque
    motor_turns_per_handle_turn: Annotated[float, _GEAR] = 1.0
    opens_with_positive_motor: bool = True
    shut_at_motor_turns: Annotated[float, _TURNS] = Field(
        0.0, description="position estimate of the drive with the handle shut"
    )
    widest_rad: Annotated[float, between(0.01, 6.3, "rad", "a handle opens by no more than a turn, and it opens")] = (
        Field(
            2.1,
            description="largest angle of the handle (assumed); beyond it, or a quarter of it below shut, is a fault",
        )
    )
    count_rad: Annotated[float, _COUNT_RAD] = Field(
        2e-3, description="motion of the handle per encoder count (none: of 12 bits, rounded up)"
    )
    friction_nm: Annotated[float, _DRY_NM] = Field(
        5e-3, description="friction of the handle, motor off, measured or assumed"
    )
    sure_friction: Annotated[float, _SHARE] = Field(
        0.5,
        description="share of it that the handle surely has: smaller torques give a hand no energy, and have no bound",
    )
    interface_delay_s: Annotated[float, _DELAY] = Field(
        2.5e-3,
        description="longest time that drive and bus add from a motion to the torque that answers it: age of a "
        "position, and transport",
    )
    sudden_rad: Annotated[float, between(0.0, 1.0, "rad", "no handle turns further in a tick of 2 ms")] = Field(
        0.02,
        description="by how much more than in the last tick a hand may turn it in this: fingers and handle are light",
    )
    max_motor_turns_s: Annotated[float, _SPEED]
    max_motor_current_a: Annotated[float, _CURRENT]
    watchdog_s: Annotated[
        float, between(0.02, 0.5, "s", "a drive pulls for so long after its last order, and may miss some orders")
    ] = Field(description="set on the drive itself")
    feedback_timeout_s: Annotated[float, _A_BLINK] = 0.005
    heartbeat_timeout_s: Annotated[float, _A_BLINK] = 0.3

    def own(self) -> tuple[float, float, float]:
        """Return count, sure friction and sudden change, for the energy bound."""
        return self.count_rad, self.sure_friction * self.friction_nm, self.sudden_rad


class GripperFile(Settings):
    """The gripper of an arm, with a motor of its own."""

    kind: Literal["gripper"]
    model: str
    max_force_n: Annotated[float, _FORCE] = Field(description="at the fingers")
    lever_m: Annotated[float, between(5e-3, 0.2, "m", "a finger is no nearer to the axis, and no further")] = Field(
        description="distance of the fingers from the gripper's axis"
    )
    opens_with_positive_force: bool = True
    widest_rad: Annotated[float, between(0.01, 6.3, "rad", "a gripper opens by no more than a turn, and it opens")]
    count_rad: Annotated[float, _COUNT_RAD] = Field(description="motion of the gripper per encoder count")
    friction_nm: Annotated[float, _DRY_NM] = Field(description="friction of the gripper, motor off")
    sure_friction: Annotated[float, _SHARE] = SURE_FRICTION
    interface_delay_s: Annotated[float, _DELAY] = 2.5e-3
    sudden_rad: Annotated[float, between(0.0, 1.0, "rad", "no gripper turns further in a tick of 2 ms")] = 0.02
    velocity_filter_hz: Annotated[float, between(1.0, 249.0, "Hz", "half of the rate of 500 Hz")] = 60.0

    def own(self) -> tuple[float, float, float]:
        """Return count, sure friction and sudden change, for the energy bound."""
        return self.count_rad, self.sure_friction * self.friction_nm, self.sudden_rad


DeviceFile = Annotated[ArmFile | GraspFile | GripperFile, Field(discriminator="kind")]
