"""Which of the catheters as sold passes a duct."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.services.anatomy.centring import Centreline
from trocar.services.meshes.errors import MeshError
from trocar.services.runtime.config.products import load_product

CATHETERS = "cholangiography_5fr", "cholangiography_4fr"
"""Of configs/catheters, the widest first."""
ROOM = 1.15
"""A lumen is so much wider than the catheter that slides in it."""


def outer_diameter_m(product: str) -> float:
    """Return the outer diameter of a catheter as sold."""
    return load_product(product).values["outer_diameter_m"].value


def fitting_catheter(lines: Sequence[Centreline], thickness_m: float) -> str:
    """Return the widest catheter that passes all of the lumen.

    Raises MeshError that names the narrowest place if none does.

    Args:
        lines: Centrelines with their sections at the middle of the wall.
        thickness_m: Of the wall.
    """
    line = min(lines, key=lambda each: float(each.diameters_m.min()))
    k = int(line.diameters_m.argmin())
    lumen_m = float(line.diameters_m[k]) - thickness_m
    for name in CATHETERS:
        if lumen_m >= ROOM * outer_diameter_m(name):
            return name
    place = np.round(1e3 * line.points_m[k], 1).tolist()
    raise MeshError(
        f"the lumen is {1e3 * lumen_m:.2g} mm wide at {place} mm, the thinnest catheter has "
        f"{1e3 * outer_diameter_m(CATHETERS[-1]):.3g} mm: segment it without the branches that narrow"
    )
