"""A drive that pushes and twists a catheter from behind, with a handle that steers its tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from services.mechanics.scene.instruments.tool import ToolScene


@dataclass(frozen=True, slots=True, kw_only=True)
class FromBehind(ToolScene):
    """A holder of a proximal end: it touches nothing else, and holds on while it is there.

    Its port lies on the catheter's axis, ``behind_m`` behind the proximal end, wherever a scene file says: moving J
    along the shaft pushes, rolling it twists.
    """

    behind_m: float = 60e-3

    positive: ClassVar[tuple[str, ...]] = (*ToolScene.positive, "behind_m")

    @property
    def body_radius_m(self) -> float:
        """Nothing of it touches."""
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
        """The handle's own angle steers."""
        return 1.0, self.handle_max_angle_rad
