"""An element: its stiffness and its known limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from trocar.services.mechanics.arrays import FloatArray


class StiffnessKernel(Protocol):
    """Stiffness of many triangles at once.

    Membrane elements act on (u, v, theta_z) of each node, bending elements on (w, theta_x, theta_y), where
    theta_x = dw/dy and theta_y = -dw/dx are components of the rotation vector.
    """

    def __call__(self, xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
        """(m, 9, 9) from (m, 3, 2) counter-clockwise local nodes in m, (m, 3, 3) plane stress per strain in Pa (xx, yy,
        engineering xy), and (m,) thickness in m.
        """
        ...


@dataclass(frozen=True)
class Element:
    """One row of a table of elements.

    Attributes:
        stiffness: Of many triangles at once.
        is_reference_only: The element fails the patch test or depends on the order of its nodes, so it serves
            comparisons only.
        has_stiff_drilling: Of a membrane: its drilling rotations are about as stiff as its shear, which makes torsion
            of a thick wall of short flat triangles too stiff (`trocar.studies.fem.facets.drilling_excess`) and a
            curved rim under forces too soft (`trocar.studies.fem.facets.rim_eccentricity`).
    """

    stiffness: StiffnessKernel
    is_reference_only: bool = False
    has_stiff_drilling: bool = False
