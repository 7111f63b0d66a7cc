"""What a contact law is: a module of kernels by which every solve meets it, and of constants.

It relates the force on the first body at two touching points to their gap and slip.

open_row : kernel (rows, row)
    Write what is particular to the law into a fresh row: softness, limits.
relax : kernel (problem, W, block)
    Solve the law exactly for one contact with the others fixed; `carry_change` keeps the motion with the force.
add_unknowns : kernel (problem, block, unknowns, n) -> int
    List what a Newton step may change of this contact, and return the new number of unknowns.
project : kernel (problem, block)
    Put the force back into the set that the law admits.
slides : kernel (rows, row) -> bool
    Whether the solved force is on its limit, so that the contact slides.
closed_axes : kernel (rows, row, slides) -> int
    How many of the three axes stay closed when a body is moved a little: 0, 1 (normal) or 3.
penalty : kernel (rows, row, motion, gains)
    Write the explicit counterpart of the law into ``rows.force_n``; ``motion`` are the normal and both tangential
    components of the slip.
room : kernel (rows, row, change) -> float, optional
    What part of a change of the force, along the row's axes and 1 at most, goes before the contact opens or slips; all
    of it, unless the law says so.
HAS_GAP : bool
    Whether ``gap_m`` is a distance between two surfaces, so that a negative one is a penetration and a pressed point is
    a candidate again in the next tick.
FIXES_DISTANCE : bool, optional
    Whether the law asks for the whole distance between two points at the end of the step, not for its change.
ELASTIC_AXES : int, optional
    Along how many of the row's last axes the contact remembers its elastic slip from tick to tick, see `anchors`.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.contact.rows import ContactRows

# The local solves put a sliding force on its limit to rounding; anything closer than this is on it.
ON_THE_LIMIT = 1.0 - 1e-9


class ContactProblem(Struct):
    """The complementarity problem of k contacts in contact space: 3 k rows, normal and two tangents each.

    It goes with the Delassus operator W (3 k, 3 k) in m/N, symmetric positive.

    Attributes:
        rows: ContactRows. Laws, limits, and the present forces.
        motion: (3 C,) float64. Gaps and slips at the end of the step with the present forces, in m.
        change: (3,) float64. What the last relaxation changed of a contact's force, in N.
    """

    rows: ContactRows
    motion: Annotated[FloatArray, "m"]
    change: Annotated[FloatArray, 3]


class Unknowns(Struct):
    """What a Newton step solves for, at most m unknowns; see `newton`."""

    block: Annotated[IntArray, "m"]
    test: Annotated[FloatArray, "m", 3]
    column: Annotated[FloatArray, "m", 3]
    shift: Annotated[FloatArray, "m"]  # lambda
    matrix: Annotated[FloatArray, "m * m"]
    step: Annotated[FloatArray, "m"]
    along: Annotated[FloatArray, "m"]  # scratch


class PenaltyGains(NamedTuple):
    """Spring and damper of penalty contact, the step, and the lightest mass that a contact acts on."""

    stiffness_n_m: float
    damping_n_s_m: float
    dt_s: float
    lightest_kg: float


@kernel
def carry_change(problem: ContactProblem, W: FloatArray, block: int, axis: int, change: float) -> None:
    """Note what changed of a contact's force along an axis, and bring the motion of all rows up to date.

    An update along a row of the symmetric W vectorises, a dot product would not.
    """
    row, motion = 3 * block + axis, problem.motion
    problem.change[axis] = change
    if change != 0.0:
        for column in range(W.shape[0]):
            motion[column] += W[row, column] * change


@kernel
def add_unknown(out: Unknowns, n: int, block: int, test: tuple[float, float, float], shift: float) -> int:
    """Add an unknown whose force changes along its test direction, and return the new number of unknowns."""
    out.block[n], out.shift[n] = block, shift
    for axis in range(3):
        out.test[n, axis] = out.column[n, axis] = test[axis]
    return n + 1


@kernel
def add_axes(out: Unknowns, n: int, block: int) -> int:
    """Add the three axes of a contact that sticks or is held, and return the new number of unknowns."""
    n = add_unknown(out, n, block, (1.0, 0.0, 0.0), 0.0)
    n = add_unknown(out, n, block, (0.0, 1.0, 0.0), 0.0)
    return add_unknown(out, n, block, (0.0, 0.0, 1.0), 0.0)
