"""The files of configs/devices: a device's limits as data. Simulated and real drivers read the same file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.services.gateway.driver import ArmLimits
from trocar.services.runtime.bounds import Torque, between
from trocar.services.runtime.rig import Settings

_FORCE = between(0.01, 50.0, "N", "the strongest arm for a hand, a Premium High Force, gives 37.5 N")
_CURRENT = between(0.01, 40.0, "A", "an ODrive S1 bears no more for long, and no motor turns with less")
_A_BLINK = between(1e-3, 1.0, "s", "a drive that is silent for longer would go on pushing; a tick takes 0.001 s")
_COUNT = between(1e-8, 2e-4, "m", "no encoder of an arm is finer, and a coarser one is felt as grain")
_FRICTION = between(1e-4, 2.0, "N", "every arm has some, and more would hide all forces")
_NYQUIST = between(1.0, 499.0, "Hz", "a velocity is known up to half of the rate of 1 kHz, and has to follow a hand")
_GEAR = between(0.01, 1000.0, "", "a handle's gear lies between")
_TURNS = between(-1000.0, 1000.0, "turns", "a handle goes through no more turns of its motor")
_SPEED = between(0.01, 1000.0, "turns/s", "no motor of a handle is faster, and with less a handle stands")
_OFFSET = Annotated[float, between(-1.0, 1.0, "m", "the workspace of the largest arm, a Premium 3.0, is 0.84 m wide")]


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
        description="friction at the tip, motors off: smaller forces give a hand no energy, and have no bound"
    )
    max_damping_n_s_m: Annotated[float, between(0.0, 1000.0, "N s/m", "no arm is damped more")] | None = Field(
        None, description="has no effect; older files name it"
    )
    velocity_filter_hz: Annotated[float, _NYQUIST] = 100.0
    openhaptics_centre_m: tuple[_OFFSET, _OFFSET, _OFFSET] = Field(
        (0.0, 0.0, 0.0), description="middle of the workspace as OpenHaptics counts: right, up, toward the user"
    )

    def limits(self) -> ArmLimits:
        """Return the limits for the servo."""
        return ArmLimits(
            self.max_force_n,
            self.continuous_force_n,
            self.max_velocity_m_s,
            self.count_m,
            self.friction_n,
        )


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
    max_motor_turns_s: Annotated[float, _SPEED]
    max_motor_current_a: Annotated[float, _CURRENT]
    watchdog_s: Annotated[
        float, between(0.02, 0.5, "s", "a drive pulls for so long after its last order, and may miss some orders")
    ] = Field(description="set on the drive itself")
    feedback_timeout_s: Annotated[float, _A_BLINK] = 0.005
    heartbeat_timeout_s: Annotated[float, _A_BLINK] = 0.3


DeviceFile = Annotated[ArmFile | GraspFile, Field(discriminator="kind")]
