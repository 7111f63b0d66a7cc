"""A probe that palpates with a sphere at its tip, the only part that has contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from trocar.services.mechanics.scene.instruments.tool import SHAFT_M, DrawnPart, ToolScene

_NECK_M = 12e-3
_RINGS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeScene(ToolScene):
    """A point-based probe: one sphere at the end of a shaft; neither jaws nor handle.

    Its force is rendered as for a point: the proxy stays on the surface of the touched body while the hand enters it,
    and the coupling between both is the force (Zilles and Salisbury, IROS 1995; for a proxy with a radius Ruspini,
    Kolarov and Khatib, SIGGRAPH 1997). J is the middle of the sphere. The shaft passes through all bodies.
    """

    kind: Literal["probe"] = "probe"
    tip_radius_m: float = 1.5e-3

    touches_along_shaft: ClassVar[bool] = False
    positive: ClassVar[tuple[str, ...]] = ("shaft_radius_m", "tip_radius_m", "coupling_stiffness_n_m")

    @property
    def body_radius_m(self) -> float:
        """Radius of the sphere."""
        return self.tip_radius_m

    def drawn(self) -> tuple[DrawnPart, ...]:
        """Return the dark shaft, a steel neck and the sphere."""
        shaft, tip = self.shaft_radius_m, self.tip_radius_m
        angles = [math.pi * (0.2 + 0.8 * k / _RINGS) for k in range(_RINGS + 1)]
        sphere = tuple((-tip * math.cos(angle), max(tip * math.sin(angle), 0.0)) for angle in angles)
        neck = (-_NECK_M, 0.9 * shaft), (-0.5 * _NECK_M, 0.45 * tip), (sphere[0][0], 0.45 * tip)
        sleeve = (-SHAFT_M, shaft), (-_NECK_M, shaft), (-_NECK_M, 0.0)
        return DrawnPart("sleeve", sleeve), DrawnPart("steel", neck), DrawnPart("steel", sphere)
