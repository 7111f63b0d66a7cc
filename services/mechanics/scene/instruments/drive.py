"""A drive that pushes and twists a catheter from behind, with a handle that steers its tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from trocar.services.mechanics.scene.instruments.tool import ToolScene


@dataclass(frozen=True, slots=True, kw_only=True)
class FromBehind(ToolScene):
    """A holder of a proximal end: it has no other contact, and holds as long as it is present.

    Its port is placed on the catheter's axis, ``behind_m`` behind the proximal end, whatever the scene file says.
    Moving J along the shaft pushes, rolling it twists.
    """

    behind_m: float = 60e-3

    positive: ClassVar[tuple[str, ...]] = (*ToolScene.positive, "behind_m")

    @property
    def body_radius_m(self) -> float:
        """Return 0, as it has no contact."""
        return 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveScene(FromBehind):
    """A holder of the catheter's proximal end: it pushes and twists, and its handle steers, with the effect twist."""

    kind: Literal["drive"] = "drive"
    handle_max_angle_rad: float = 1.0

    has_handle: ClassVar[bool] = True
    drives_catheter: ClassVar[bool] = True
    positive: ClassVar[tuple[str, ...]] = (*FromBehind.positive, "handle_max_angle_rad")

    @property
    def handle_range(self) -> tuple[float, float]:
        """Return a ratio of 1, as the handle's own angle steers."""
        return 1.0, self.handle_max_angle_rad
