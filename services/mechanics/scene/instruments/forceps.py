"""Laparoscopic forceps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from trocar.services.mechanics.scene.instruments.tool import SHAFT_M, DrawnPart, ToolScene


@dataclass(frozen=True, slots=True, kw_only=True)
class ForcepsScene(ToolScene):
    """One laparoscopic forceps: a shaft through a fixed port and two jaws, coupled to the hand by springs.

    The jaw angle is the opening between both jaws; it is ``jaw_ratio`` times the angle of the handle.
    """

    kind: Literal["forceps"] = "forceps"
    jaw_radius_m: float = 1.0e-3
    jaw_length_m: float = 15e-3
    jaw_ratio: float = 1.0
    jaw_max_angle_rad: float = 1.0
    jaw_stiffness_nm_rad: float = 0.2
    jaw_damping_nm_s_rad: float = 2e-4
    grip_friction: float = 0.5
    grasp_torque_nm: float = 2e-3
    release_angle_rad: float = 0.03

    has_handle: ClassVar[bool] = True
    positive: ClassVar[tuple[str, ...]] = (
        *("shaft_radius_m", "jaw_radius_m", "jaw_length_m", "jaw_ratio", "jaw_max_angle_rad"),
        *("coupling_stiffness_n_m", "jaw_stiffness_nm_rad", "grasp_torque_nm"),
    )
    not_negative: ClassVar[tuple[str, ...]] = (
        *("coupling_damping_n_s_m", "jaw_damping_nm_s_rad", "grip_friction", "release_angle_rad"),
    )

    @property
    def jaws(self) -> ForcepsScene:
        """Return itself."""
        return self

    @property
    def handle_range(self) -> tuple[float, float]:
        """Return the handle's ratio and range for the jaws."""
        return self.jaw_ratio, self.jaw_max_angle_rad

    def drawn(self) -> tuple[DrawnPart, ...]:
        """Return the dark shaft and the steel between it and the jaws."""
        r, j = self.shaft_radius_m, self.jaw_radius_m
        clevis = ((-9e-3, 0.96 * r), (-6e-3, 0.82 * r), (-1e-3, 1.7 * j), (0.6e-3, 1.25 * j), (0.6e-3, 0.0))
        return DrawnPart("sleeve", ((-SHAFT_M, r), (-9e-3, r), (-9e-3, 0.0))), DrawnPart("steel", clevis)
