"""A drive that pushes and twists a guide wire from behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from services.mechanics.scene.instruments.tool import ToolScene


@dataclass(frozen=True, slots=True, kw_only=True)
class WireDriveScene(ToolScene):
    """A holder of the guide wire's proximal end: it touches nothing else, and holds on while it is there.

    Its port lies on the catheter's axis, ``behind_m`` behind the catheter's proximal end, wherever a scene file says:
    moving J along the shaft pushes, rolling it twists.
    """

    kind: Literal["wire_drive"] = "wire_drive"
    behind_m: float = 60e-3
    coupling_damping_n_s_m: float = 0.1

    drives_wire: ClassVar[bool] = True
    positive: ClassVar[tuple[str, ...]] = ("shaft_radius_m", "coupling_stiffness_n_m", "behind_m")

    @property
    def body_radius_m(self) -> float:
        """Nothing of it touches."""
        return 0.0
