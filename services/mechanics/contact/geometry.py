"""Geometry that contact rows are built from: poses of tools, catheter and duct, and their motion without contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.forceps.kinematics import N_CELLS, N_COORDINATES, N_SEGMENTS
from services.mechanics.bodies.forceps.tool_body import ToolBody
from services.mechanics.compiled.struct import Struct, reader
from services.mechanics.contact.spheres import Spheres, no_spheres
from services.mechanics.scene.tools import N_TOOLS


@dataclass(frozen=True, slots=True)
class Bodies:
    """Everything that contacts can push."""

    duct: DuctBody
    catheter: CatheterBody
    tools: ToolBody
    half_thickness_m: float


class ToolGeometry(Struct):
    """Poses of both tools at the start of the step and their motion over it without contact forces."""

    segments: Annotated[FloatArray, N_TOOLS, N_SEGMENTS, 2, 3]
    radius: Annotated[FloatArray, N_TOOLS, N_SEGMENTS]
    frame: Annotated[FloatArray, N_TOOLS, 3, 3]
    length: Annotated[FloatArray, N_TOOLS]
    motion: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    rolled: Annotated[FloatArray, N_TOOLS]
    present: Annotated[BoolArray, N_TOOLS]
    disengaged: Annotated[BoolArray, N_TOOLS]  # without contacts until clear, see `engagement`
    held: Annotated[BoolArray, N_TOOLS, 2]  # whether the jaws hold something of each target kind
    rest_offset: Annotated[FloatArray, N_TOOLS, 2]  # overlap with the held body up to which none pushes, m
    indentation: Annotated[FloatArray, N_TOOLS, N_CELLS]  # loss of the squeezed wall's half thickness, m
    indentation_slope: Annotated[FloatArray, N_TOOLS, N_CELLS]  # its change with the opening, m/rad
    wall_thickness: float  # m


class RodGeometry(Struct):
    """Particles of the catheter at the start of the step and their motion over it without contact forces."""

    position: Annotated[FloatArray, "n", 3]
    motion: Annotated[FloatArray, "n", 3]
    radius: Annotated[FloatArray, "n"]  # of the segment that begins at each; of the last one, that before it


class WallGeometry(Struct):
    """The undeformed mid-surface of the duct."""

    vertices: Annotated[FloatArray, "n", 3]
    triangles: Annotated[IntArray, "m", 3]
    half_thickness: float


class ContactGeometry(Struct):
    """Everything that contact rows are built from."""

    tools: ToolGeometry
    rod: RodGeometry
    wall: WallGeometry
    spheres: Spheres

    @classmethod
    def of(cls, bodies: Bodies) -> ContactGeometry:
        """View the arrays of the bodies."""
        tools, catheter, mesh = bodies.tools, bodies.catheter, bodies.duct.reduced.mesh
        return cls(
            tools=ToolGeometry(
                segments=tools.segments,
                radius=tools.radius_m,
                frame=tools.frame,
                length=tools.length_m,
                motion=tools.motion,
                rolled=tools.rolled_rad,
                present=tools.present,
                disengaged=tools.disengaged,
                held=tools.held,
                rest_offset=tools.rest_offset_m,
                indentation=tools.indentation_m,
                indentation_slope=tools.indentation_slope_m_rad,
                wall_thickness=2.0 * bodies.half_thickness_m,
            ),
            rod=RodGeometry(position=catheter.start_m, motion=catheter.motion_m, radius=catheter.radii_m),
            wall=WallGeometry(
                vertices=mesh.vertices_m, triangles=mesh.triangles, half_thickness=bodies.half_thickness_m
            ),
            spheres=no_spheres(),
        )


geometry_at = reader(ContactGeometry)
