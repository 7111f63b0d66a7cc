"""What contact rows are built from: where tools, catheter and duct are, and how they move without contact forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.forceps.tool_body import ToolBody


@dataclass(frozen=True, slots=True)
class Bodies:
    """Everything that contacts can push."""

    duct: DuctBody
    catheter: CatheterBody
    tools: ToolBody
    half_thickness_m: float


class ToolGeometry(NamedTuple):
    """Poses of both tools at the start of the step and their motion over it without contact forces."""

    segments: FloatArray  # (2, 3, 2, 3)
    radius: FloatArray  # (2, 3)
    frame: FloatArray  # (2, 3, 3)
    length: FloatArray  # (2,)
    motion: FloatArray  # (2, 4)
    held: BoolArray  # (2, 2) whether the jaws hold something of each target kind


class RodGeometry(NamedTuple):
    """Particles of the catheter at the start of the step and their motion over it without contact forces."""

    position: FloatArray  # (n, 3)
    motion: FloatArray  # (n, 3)
    radius: float


class WallGeometry(NamedTuple):
    """The undeformed mid-surface of the duct."""

    vertices: FloatArray  # (n, 3)
    triangles: IntArray  # (m, 3)
    half_thickness: float


class ContactGeometry(NamedTuple):
    """Everything that contact rows are built from."""

    tools: ToolGeometry
    rod: RodGeometry
    wall: WallGeometry

    @classmethod
    def of(cls, bodies: Bodies) -> ContactGeometry:
        """View the arrays of the bodies."""
        tools, catheter, mesh = bodies.tools, bodies.catheter, bodies.duct.reduced.mesh
        return cls(
            ToolGeometry(tools.segments, tools.radius_m, tools.frame, tools.length_m, tools.motion, tools.held),
            RodGeometry(catheter.start_m, catheter.motion_m, catheter.radius_m),
            WallGeometry(mesh.vertices_m, mesh.triangles, bodies.half_thickness_m),
        )
