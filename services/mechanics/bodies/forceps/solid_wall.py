r"""Resistance of two layers of wall squeezed between two jaws, after their inner sides have come into contact.

A jaw is a round bar of radius r, and the layers are an elastic foundation between two bars (Johnson, "Contact
Mechanics", 1985, 4.3). With a distance h between the jaws, the layers of thickness H = 2 t have the strain
:math:`\epsilon = 1 - h / H`. The strain also widens the squeezed strip, so the force per length of jaw is

.. math:: w = \tfrac43 \frac{E}{1 - \nu^2} \sqrt{r H} \; \frac{\epsilon^{3/2}}{1 - \epsilon} .

The numerator is that of a linear foundation of modulus E / (1 - nu^2) (plane strain, because the jaws are long) between
parabolic surfaces; its slope is continuous at zero strain. The denominator relates the increment to the remaining
thickness, so that a nearly incompressible wall is never squeezed to zero thickness. Strain stiffening of tissue under
graspers (exponential in Rosen et al., J. Biomech. Eng. 130:021020, 2008) is not included: no data for a duct's wall
have been published.

Jaws open like scissors: at a distance s from the hinge they are :math:`h = 2 s \sin(\theta / 2) - 2 r` apart.

A cell that is being released, with the fraction o left, yields by :math:`(1 - o)^2 (H + 2 r)`, so that the jaws are
shut when nothing is left. If only the modulus fell, the jaws would stay nearly as far apart to the end, because of the
denominator, and a hand would then lose 29 mN m of torque in one tick.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.scene.tools import N_TOOLS

_MAX_STRAIN = 1.0 - 1e-9  # keeps the stored energy finite where something else shuts the jaws


class SolidWall(Struct):
    """Cells of both tools' jaws, and the wall in them."""

    occupied: Annotated[FloatArray, N_TOOLS, N_CELLS]  # fraction of each cell that wall fills, 0 to 1
    free_m: Annotated[FloatArray, N_TOOLS, N_CELLS]  # unstrained thickness: both layers', or the room at occupation
    layers: Annotated[FloatArray, N_TOOLS, N_CELLS]  # how many layers share the room between the jaws, no whole number
    length_m: Annotated[FloatArray, N_TOOLS]  # of the jaws
    radius_m: Annotated[FloatArray, N_TOOLS]
    thickness_m: float  # of both layers
    modulus_pa: float  # E / (1 - nu^2)


@kernel
def cell_m(wall: SolidWall, tool: int, cell: int) -> float:
    """Return the distance (m) of the middle of a cell from the hinge."""
    return float(wall.length_m[tool] * (cell + 0.5) / N_CELLS)


@kernel
def jaw_gap_m(wall: SolidWall, tool: int, cell: int, opening_rad: float) -> float:
    """Return the distance (m) between the jaws in a cell; negative near the hinge, where the jaws overlap."""
    return float(2.0 * (cell_m(wall, tool, cell) * math.sin(0.5 * opening_rad) - wall.radius_m[tool]))


@kernel
def _strain(wall: SolidWall, tool: int, cell: int, opening_rad: float) -> float:
    """Return the compressive strain in a cell: at least 1 if no gap is left between the jaws, 0.0 if it is empty."""
    if wall.occupied[tool, cell] == 0.0:
        return 0.0
    free, released = wall.free_m[tool, cell], 1.0 - wall.occupied[tool, cell]
    release_m = released * released * (free + 2.0 * wall.radius_m[tool])
    return float(1.0 - (jaw_gap_m(wall, tool, cell, opening_rad) + release_m) / free)


@inlined_kernel
def write_indentation(wall: SolidWall, tool: int, opening_rad: float, out: FloatArray, slope: FloatArray) -> None:
    """Write the indentation (N_CELLS,) in m: by how much squeezing brings a layer's middle surface nearer to its jaw.

    Half a layer is thinner by t / 2 - h / 2 n, with n layers in a distance h of the jaws. ``slope`` (N_CELLS,) receives
    the derivative by the opening, in m/rad. All cells use the largest occupied fraction: where the jaws squeeze a fold
    in some cells, its ridge in the others has no more room.
    """
    share = wall.occupied[tool].max()
    if share == 0.0:
        out[:] = slope[:] = 0.0
        return
    for cell in range(N_CELLS):
        gap_m, layers = jaw_gap_m(wall, tool, cell, opening_rad), wall.layers[tool, cell]
        free_m = 0.5 * layers * wall.thickness_m
        out[cell] = slope[cell] = 0.0
        if layers > 0.0 and gap_m < free_m:
            out[cell] = 0.5 * share * (free_m - max(gap_m, 0.0)) / layers
            if gap_m > 0.0:
                slope[cell] = -0.5 * share * cell_m(wall, tool, cell) * math.cos(0.5 * opening_rad) / layers


@kernel
def wall_reaction(wall: SolidWall, tool: int, opening_rad: float) -> tuple[float, float, float]:
    """Return the torque that opens the jaws (N m), its stiffness (N m/rad), and the force on each jaw (N).

    The stiffness is the decrease of the torque per opening. All are infinite if a cell's strain is 1 or more.
    """
    torque, stiffness, total = 0.0, 0.0, 0.0
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
        force_slope = force * (1.5 / strain + 1.0 / (1.0 - strain)) / wall.free_m[tool, cell]
        stiffness += force_slope * (arm * cosine) ** 2 + 0.5 * force * arm * sine
    return torque, stiffness, total


@inlined_kernel
def stored_energy_j(wall: SolidWall, tool: int, opening_rad: float) -> float:
    """Return the elastic energy of all cells of a tool in J, the integral of their forces over the thickness."""
    total = 0.0
    for cell in range(N_CELLS):
        strain = _strain(wall, tool, cell, opening_rad)
        if strain > 0.0:
            root = math.sqrt(min(strain, _MAX_STRAIN))
            scale = 2.0 * _scale_n(wall, tool, cell) * wall.free_m[tool, cell]
            total += scale * (math.atanh(root) - root - strain * root / 3.0)
    return total


@kernel
def _scale_n(wall: SolidWall, tool: int, cell: int) -> float:
    """Return the factor (N) in front of the function of strain, for the occupied length of a cell."""
    share = wall.occupied[tool, cell] * wall.length_m[tool] / N_CELLS
    return float(4.0 / 3.0 * wall.modulus_pa * math.sqrt(wall.radius_m[tool] * wall.free_m[tool, cell]) * share)


@inlined_kernel
def equilibrium_opening(wall: SolidWall, tool: int, free_rad: float, compliance: float) -> float:
    """Return the opening (rad) at which the wall alone balances the coupling; without wall it is ``free_rad``.

    It is the root of ``opening - free_rad - compliance * torque``, which increases monotonically, with the coupling's
    ``compliance`` in rad/(N m), found by bisection. The result is at most 1e-8 rad too small, and the torque there is
    finite. If the root is within 1e-8 rad of an infinite torque, the result is at most as much too large instead.
    """
    low, high = free_rad, free_rad + 1.0
    torque = wall_reaction(wall, tool, low)[0]
    if torque == 0.0:
        return free_rad
    if high - free_rad < compliance * wall_reaction(wall, tool, high)[0]:
        high = max(high, math.pi)  # jaws that open wider than others
    while high - low > 1e-8:
        middle = 0.5 * (low + high)
        at_middle = wall_reaction(wall, tool, middle)[0]
        if middle - free_rad < compliance * at_middle:
            low, torque = middle, at_middle
        else:
            high = middle
    return low if torque < math.inf else high
