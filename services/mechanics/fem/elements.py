"""The interface of all elements, and the table from names to elements."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.fem import cst, dkt, opt, paper


class StiffnessKernel(Protocol):
    """Stiffness of many triangles at once.

    Membrane elements act on (u, v, theta_z) of each node, bending elements on (w, theta_x, theta_y), where
    theta_x = dw/dy and theta_y = -dw/dx are components of the rotation vector.
    """

    def __call__(self, xy: FloatArray, rigidity: FloatArray) -> FloatArray:
        """(m, 9, 9) from (m, 3, 2) counter-clockwise local nodes and (m, 3, 3) rigidity.

        The rigidity is the plane-stress matrix times the thickness for a membrane (N/m), times
        thickness³ / 12 for bending (N m).
        """
        ...


MEMBRANE_ELEMENTS: dict[str, StiffnessKernel] = {"cst": cst.stiffness, "opt": opt.stiffness}
BENDING_ELEMENTS: dict[str, StiffnessKernel] = {"dkt": dkt.stiffness, "paper": paper.stiffness}


def choose(table: dict[str, StiffnessKernel], name: str, kind: str) -> StiffnessKernel:
    """Look up an element by name.

    Raises
    ------
    ValueError
        There is no such element; the message lists those there are.
    """
    if name not in table:
        raise ValueError(f"unknown {kind} element '{name}'; known: {', '.join(table)}")
    return table[name]


MEMBRANE_DOFS = np.array([0, 1, 5, 6, 7, 11, 12, 13, 17])
BENDING_DOFS = np.array([2, 3, 4, 8, 9, 10, 14, 15, 16])
"""Where the nine dofs of each part lie among the 18 local ones (u, v, w, theta_x, theta_y, theta_z per node)."""
