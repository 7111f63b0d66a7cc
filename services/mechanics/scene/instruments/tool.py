"""Base of all instruments: a shaft through a fixed port, a coupling to the hand, a drawing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

if TYPE_CHECKING:
    from trocar.services.mechanics.scene.instruments.forceps import ForcepsScene

Vector3 = tuple[float, float, float]
SHAFT_M = 0.26
"""Drawn length of the shaft."""


@dataclass(frozen=True, slots=True)
class DrawnPart:
    """A part that is round about the shaft's axis.

    ``profile`` lists (x, radius) in m from the handle to the tip, x along the shaft from the junction J on.
    """

    material: Literal["sleeve", "steel"]
    profile: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolScene:
    """One instrument: a shaft that turns about a port and slides through it, tied to the hand by a spring and a damper.

    A kind of instrument is a class derived from this one, in a file of its own, and a row in `TOOLS`. Its fields are
    the keys of a scene file; ``positive`` and ``not_negative`` name those that are bounded so. The hand moves its
    junction J, the end of the shaft, and feels the force there; jaws lie beyond it.
    """

    kind: str
    port_position_m: Vector3 = (0.08, -0.05, 0.15)
    shaft_radius_m: float = 2.5e-3
    coupling_stiffness_n_m: float = 500.0
    coupling_damping_n_s_m: float = 1.0

    has_handle: ClassVar[bool] = False
    """Whether it has a handle, and so a drive for the handle."""
    drives_catheter: ClassVar[bool] = False
    """Whether it holds the catheter's proximal end."""
    drives_wire: ClassVar[bool] = False
    """Whether it holds the guide wire's."""
    touches_along_shaft: ClassVar[bool] = True
    """Whether all of the shaft inside the port has contact, or only a sphere about J."""
    positive: ClassVar[tuple[str, ...]] = ("shaft_radius_m", "coupling_stiffness_n_m")
    not_negative: ClassVar[tuple[str, ...]] = ("coupling_damping_n_s_m",)

    @property
    def jaws(self) -> ForcepsScene | None:
        """Return the settings of its jaws; None for a tool without jaws, which cannot grasp."""
        return None

    @property
    def handle_range(self) -> tuple[float, float]:
        """Return the handle's ratio and the largest angle of the part that it moves; zero without a handle."""
        return 1.0, 0.0

    @property
    def body_radius_m(self) -> float:
        """Radius of the contact geometry besides jaws: of the shaft or of the sphere about J; 0 without any."""
        return self.shaft_radius_m

    def drawn(self) -> tuple[DrawnPart, ...]:
        """Return its drawn parts besides jaws and port."""
        return (DrawnPart("sleeve", ((-SHAFT_M, self.shaft_radius_m), (0.0, self.shaft_radius_m), (0.0, 0.0))),)
