"""A drive that pushes and twists a guide wire from behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from trocar.services.mechanics.scene.instruments.drive import FromBehind


@dataclass(frozen=True, slots=True, kw_only=True)
class WireDriveScene(FromBehind):
    """A holder of the guide wire's proximal end: it pushes and twists, and has no other contact."""

    kind: Literal["wire_drive"] = "wire_drive"
    coupling_damping_n_s_m: float = 0.1

    drives_wire: ClassVar[bool] = True
