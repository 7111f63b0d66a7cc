"""The files of configs/devices: a device's limits as data. Simulated and real drivers read the same file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from services.gateway.driver import ArmLimits
from services.runtime.rig import MOST_TORQUE, Settings, Vector3, at_most

_FORCE = at_most(50.0, "N", "the strongest arm for a hand, a Premium High Force, gives 37.5 N")
_CURRENT = at_most(40.0, "A", "an ODrive S1 bears no more for long")
_A_BLINK = at_most(1.0, "s", "a drive that is silent for longer would go on pushing")
Positive = Annotated[float, Field(gt=0.0)]


class ArmFile(Settings):
    """A force-feedback arm."""

    kind: Literal["arm"]
    model: str
    max_force_n: Annotated[Positive, _FORCE]
    continuous_force_n: Annotated[Positive, _FORCE]
    max_velocity_m_s: Annotated[Positive, at_most(100.0, "m/s", "no hand moves so fast")]
    count_m: Annotated[float, Field(gt=0.0, le=2e-4)] = Field(
        description="motion of the tip per encoder count: a smaller motion of a hand is not seen"
    )
    friction_n: Annotated[float, Field(gt=0.0, le=2.0)] = Field(
        description="friction at the tip, motors off: smaller forces give a hand no energy, and have no bound"
    )
    max_damping_n_s_m: Positive | None = Field(None, description="has no effect; older files name it")
    velocity_filter_hz: Annotated[float, Field(gt=0.0, lt=500.0)] = 100.0
    openhaptics_centre_m: Vector3 = Field(
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
    max_torque_nm: Annotated[Positive, MOST_TORQUE]
    motor_turns_per_handle_turn: Positive = 1.0
    opens_with_positive_motor: bool = True
    shut_at_motor_turns: float = Field(0.0, description="position estimate of the drive with the handle shut")
    widest_rad: Annotated[float, Field(gt=0.0, le=6.3)] = Field(
        2.1, description="largest angle of the handle (assumed); beyond it, or a quarter of it below shut, is a fault"
    )
    max_motor_turns_s: Positive
    max_motor_current_a: Annotated[Positive, _CURRENT]
    watchdog_s: Annotated[float, Field(ge=0.02, le=0.5)] = Field(description="set on the drive itself")
    feedback_timeout_s: Annotated[Positive, _A_BLINK] = 0.005
    heartbeat_timeout_s: Annotated[Positive, _A_BLINK] = 0.3


DeviceFile = Annotated[ArmFile | GraspFile, Field(discriminator="kind")]
