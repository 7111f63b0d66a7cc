r"""Resistance of two layers of wall that two jaws squeeze, once the inner sides of the layers have met.

A jaw is a round bar of radius r, the layers an elastic foundation between two of them (Johnson, "Contact Mechanics",
1985, 4.3). The strain :math:`\epsilon = 1 - h / H` of their thickness H = 2 t also widens the squeezed strip, so the
force per length of jaw is

.. math:: w = \tfrac43 \frac{E}{1 - \nu^2} \sqrt{r H} \; \frac{\epsilon^{3/2}}{1 - \epsilon} .

The first part is that of a linear foundation of modulus E / (1 - nu^2), plane strain as the jaws are long, between
parabolas; it begins without a kink. The divisor relates a further squeeze to the thickness that is left: a nearly
incompressible wall is never squeezed to nothing. Strain-stiffening of real tissue under graspers (an exponential in
Rosen et al., J. Biomech. Eng. 130:021020, 2008) would come on top; for a duct's wall nobody has published it.

Jaws open like scissors: at a distance s from the hinge they are :math:`h = 2 s \sin(\theta / 2) - 2 r` apart.

A cell that is being released, with a share o left, yields by :math:`(1 - o)^2 (H + 2 r)`, so that the jaws are shut
when nothing is left. A law that only became weaker would hold them nearly as far apart to the end, because it divides
by the thickness that is left; then a hand loses 29 mN m of torque in one tick.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.forceps.kinematics import N_CELLS
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.scene.tools import N_TOOLS

_FULL = 1.0 - 1e-9  # keeps the stored energy finite where something else shuts the jaws


class SolidWall(Struct):
    """Cells of both tools' jaws, and the wall in them.

    Attributes:
        occupied: (2, N_CELLS) float64. Share of each cell that wall fills, 0 to 1.
        free_m: (2, N_CELLS) float64. Unsqueezed thickness of the wall in each cell: that of both layers, or less where
            they came between jaws that had less room.
        length_m, radius_m: (2,) float64. Of the jaws.
        thickness_m: float. Of both layers.
        modulus_pa: float. E / (1 - nu^2).
    """

    occupied: Annotated[FloatArray, N_TOOLS, N_CELLS]
    free_m: Annotated[FloatArray, N_TOOLS, N_CELLS]
    length_m: Annotated[FloatArray, N_TOOLS]
    radius_m: Annotated[FloatArray, N_TOOLS]
    thickness_m: float
    modulus_pa: float


@kernel
def cell_m(wall: SolidWall, tool: int, cell: int) -> float:
    """Return the distance (m) of the middle of a cell from the hinge."""
    place: float = wall.length_m[tool] * (cell + 0.5) / N_CELLS
    return place


@kernel
def apart_m(wall: SolidWall, tool: int, cell: int, opening_rad: float) -> float:
    """Return the distance (m) between the jaws in a cell; negative near the hinge, where the jaws overlap."""
    apart: float = 2.0 * (cell_m(wall, tool, cell) * math.sin(0.5 * opening_rad) - wall.radius_m[tool])
    return apart


@kernel
def _strain(wall: SolidWall, tool: int, cell: int, opening_rad: float) -> float:
    """Return the strain of the wall in a cell: positive if squeezed, 1 or more if it has no room, 0.0 if empty."""
    if wall.occupied[tool, cell] == 0.0:
        return 0.0
    free, given_up = wall.free_m[tool, cell], 1.0 - wall.occupied[tool, cell]
    yielded = given_up * given_up * (free + 2.0 * wall.radius_m[tool])
    strain: float = 1.0 - (apart_m(wall, tool, cell, opening_rad) + yielded) / free
    return strain


@kernel
def write_indentation(
    wall: SolidWall, tool: int, openings_rad: tuple[float, float], out: FloatArray, slope: FloatArray
) -> None:
    """Write the indentation of each layer, (N_CELLS,) in m: how much nearer its middle is to its jaw when squeezed.

    ``slope`` takes its change from the first to the second opening, (N_CELLS,) in m/rad. Jaws that squeeze a fold in
    some of their cells leave no more room to its ridge, which only one jaw touches, or none.
    """
    (start_rad, end_rad), share = openings_rad, 0.0
    for cell in range(N_CELLS):
        share = max(share, wall.occupied[tool, cell])
    if share == 0.0:
        out[:] = slope[:] = 0.0
        return
    for cell in range(N_CELLS):
        out[cell] = share * _indentation_m(wall, tool, cell, start_rad)
        slope[cell] = (share * _indentation_m(wall, tool, cell, end_rad) - out[cell]) / (end_rad - start_rad)


@kernel
def _indentation_m(wall: SolidWall, tool: int, cell: int, opening_rad: float) -> float:
    thinner = wall.thickness_m - max(apart_m(wall, tool, cell, opening_rad), 0.0)
    indentation: float = 0.25 * max(thinner, 0.0)
    return indentation


@kernel
def resist(wall: SolidWall, tool: int, opening_rad: float) -> tuple[float, float, float]:
    """Return torque that opens the jaws (N m), its fall with the opening (N m/rad), and the force on each jaw (N).

    All are infinite where there is no room for the wall.
    """
    torque, fall, total = 0.0, 0.0, 0.0
    cosine, sine = math.cos(0.5 * opening_rad), math.sin(0.5 * opening_rad)
    for cell in range(N_CELLS):
        strain = _strain(wall, tool, cell, opening_rad)
        if strain <= 0.0:
            continue
        if strain >= 1.0:
            return math.inf, math.inf, math.inf
        force = _scale_n(wall, tool, cell) * strain * math.sqrt(strain) / (1.0 - strain)
        arm = cell_m(wall, tool, cell)
        total += force
        torque += force * arm * cosine
        steep = force * (1.5 / strain + 1.0 / (1.0 - strain)) / wall.free_m[tool, cell]
        fall += steep * (arm * cosine) ** 2 + 0.5 * force * arm * sine
    return torque, fall, total


@kernel
def stored_in(wall: SolidWall, tool: int, cell: int, opening_rad: float) -> float:
    """Return the energy of a cell in J: the integral of its force."""
    strain = _strain(wall, tool, cell, opening_rad)
    if strain <= 0.0:
        return 0.0
    root = math.sqrt(min(strain, _FULL))
    scale = 2.0 * _scale_n(wall, tool, cell) * wall.free_m[tool, cell]
    energy: float = scale * (math.atanh(root) - root - strain * root / 3.0)
    return energy


@kernel
def stored(wall: SolidWall, tool: int, opening_rad: float) -> float:
    """Return the energy of all cells of a tool in J."""
    total = 0.0
    for cell in range(N_CELLS):
        total += stored_in(wall, tool, cell, opening_rad)
    return total


@kernel
def _scale_n(wall: SolidWall, tool: int, cell: int) -> float:
    share = wall.occupied[tool, cell] * wall.length_m[tool] / N_CELLS
    scale: float = 4.0 / 3.0 * wall.modulus_pa * math.sqrt(wall.radius_m[tool] * wall.free_m[tool, cell]) * share
    return scale


@kernel
def yields_to(wall: SolidWall, tool: int, free_rad: float, compliance: float) -> float:
    """Return the opening at which the wall alone holds jaws that would go to ``free_rad``, at most 1e-8 too small.

    The jaws give way by ``compliance`` (rad/(N m)), so this is the root of ``opening - free - compliance torque``,
    which only rises. The torque is finite there. If the wall is so thin or so soft that the root is within 1e-8 of an
    opening without room, the result is as much too large instead.
    """
    low, high = free_rad, free_rad + 1.0
    torque = resist(wall, tool, low)[0]
    if torque == 0.0:
        return free_rad
    if high - free_rad < compliance * resist(wall, tool, high)[0]:
        high = max(high, math.pi)  # jaws that open wider than others
    while high - low > 1e-8:
        middle = 0.5 * (low + high)
        at_middle = resist(wall, tool, middle)[0]
        if middle - free_rad < compliance * at_middle:
            low, torque = middle, at_middle
        else:
            high = middle
    return low if torque < math.inf else high
