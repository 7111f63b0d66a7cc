"""Geometry from which contact rows are built: poses of the bodies, and their free motion (without contact forces)."""

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
    """The bodies on which contact forces act, and half the thickness of the wall in m."""

    duct: DuctBody
    catheter: CatheterBody
    tools: ToolBody
    half_thickness_m: float


class ToolGeometry(Struct):
    """Poses of both tools at the start of the step, and their free motion over it; in m and rad."""

    segments: Annotated[FloatArray, N_TOOLS, N_SEGMENTS, 2, 3]
    radius: Annotated[FloatArray, N_TOOLS, N_SEGMENTS]
    frame: Annotated[FloatArray, N_TOOLS, 3, 3]
    length: Annotated[FloatArray, N_TOOLS]
    motion: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    rolled: Annotated[FloatArray, N_TOOLS]
    present: Annotated[BoolArray, N_TOOLS]
    disengaged: Annotated[BoolArray, N_TOOLS]  # without contacts until clear, see `engagement`
    held: Annotated[BoolArray, N_TOOLS, 2]  # whether the jaws hold something of each target kind
    rest_offset: Annotated[FloatArray, N_TOOLS, 2]  # overlap with a held body that causes no force, m
    indentation: Annotated[FloatArray, N_TOOLS, N_CELLS]  # decrease of half the squeezed layer's thickness, m
    indentation_slope: Annotated[FloatArray, N_TOOLS, N_CELLS]  # its derivative by the opening, m/rad
    wall_thickness: float  # m


class RodGeometry(Struct):
    """Particles of the catheter at the start of the step, and their free motion over it, in m."""

    position: Annotated[FloatArray, "n", 3]
    motion: Annotated[FloatArray, "n", 3]
    radius: Annotated[FloatArray, "n"]  # of the segment that begins at each particle; the last repeats that before it


class WallGeometry(Struct):
    """The undeformed mid-surface of the duct."""

    vertices: Annotated[FloatArray, "n", 3]
    triangles: Annotated[IntArray, "m", 3]
    half_thickness: float


class ContactGeometry(Struct):
    """The geometry of all bodies."""

    tools: ToolGeometry
    rod: RodGeometry
    wall: WallGeometry
    spheres: Spheres

    @classmethod
    def of(cls, bodies: Bodies) -> ContactGeometry:
        """Return views of the bodies' arrays."""
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
