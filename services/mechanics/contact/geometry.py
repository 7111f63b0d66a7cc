"""Geometry from which contact rows are built: poses of the bodies, and their free motion (without contact forces)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays, ToolBody
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.contact.spheres import Spheres, no_spheres


@dataclass(frozen=True, slots=True)
class Bodies:
    """The bodies on which contact forces act, and half the thickness of the wall in m."""

    duct: DuctBody
    catheter: CatheterBody
    tools: ToolBody
    half_thickness_m: float


class RodGeometry(Struct):
    """Particles of the catheter at the start of the step, now, and their free motion over it, in m."""

    position: Annotated[FloatArray, "n", 3]
    position_now: Annotated[FloatArray, "n", 3]
    motion: Annotated[FloatArray, "n", 3]
    radius: Annotated[FloatArray, "n"]  # of the segment that begins at each particle; the last repeats that before it


class WallGeometry(Struct):
    """The undeformed mid-surface of the duct."""

    vertices: Annotated[FloatArray, "n", 3]
    triangles: Annotated[IntArray, "m", 3]
    half_thickness: float


class ContactGeometry(Struct):
    """The geometry of all bodies."""

    tools: ToolArrays
    rod: RodGeometry
    wall: WallGeometry
    spheres: Spheres

    @classmethod
    def of(cls, bodies: Bodies) -> ContactGeometry:
        """Return views of the bodies' arrays."""
        catheter, mesh, half_m = bodies.catheter, bodies.duct.reduced.mesh, bodies.half_thickness_m
        now_m, radii_m = catheter.state.position_m, catheter.radii_m
        bodies.tools.arrays.wall_thickness = 2.0 * half_m
        return cls(
            tools=bodies.tools.arrays,
            rod=RodGeometry(position=catheter.start_m, position_now=now_m, motion=catheter.motion_m, radius=radii_m),
            wall=WallGeometry(vertices=mesh.vertices_m, triangles=mesh.triangles, half_thickness=half_m),
            spheres=no_spheres(),
        )


geometry_at = reader(ContactGeometry)
