"""The stiffness with which a step resists the twist of joints while the directors stay.

Directors relax only before a step is taken: it takes their forces as given numbers. So the step's matrix must be as
stiff as the rod is with fixed directors, or the motion to which they give way would be thrown back (the splitting of
Eyre 1998: convex terms belong into the implicit step). Bending is in the matrix; a curved joint that is tilted out of
its plane is also twisted, by tan(theta/2) of both tilts, at torsional stiffness k. The force is -k g (g.(x - x0)), with
g the gradient of the twist and x0 where the frame's forces are taken: zero if the step goes there.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import cross, dot, row
from trocar.services.mechanics.rod.elasticity import add_joint_force, add_rank_one, joint_strain
from trocar.services.mechanics.rod.material_frame import Frame
from trocar.services.mechanics.rod.model import RodWork, work_at
from trocar.services.mechanics.rod.twist import SHARPEST, TwistModel, inverse_lengths, twist_at


@kernel
def note_turns(rod: Address[RodWork], twist: Address[TwistModel], x: FloatArray, frame: Frame) -> None:
    """Write the gradients of all joints' twist, times the root of their stiffness, for particles x (n, 3)."""
    work, model = work_at(rod), twist_at(twist)
    for i in range(work.turn.shape[0]):
        first, p = first_of(work, i), i + 1 - work.first_joint
        t, u = row(frame[0], i), row(frame[0], i + 1)
        b, size = cross(t, u), math.sqrt(model.torsion[i]) / max(1.0 + dot(t, u), SHARPEST)
        before, after = inverse_lengths(model, x, p)
        work.turn[i] = 0.0
        for c in range(3):
            for k, share in ((p - 1, before), (p, after - before), (p + 1, -after)):
                if 0 <= k < x.shape[0]:
                    work.turn[i, 3 * (k - first) + c] = size * share * b[c]
        work.turned[i] = joint_strain(work.turn[i], x, first)


@kernel
def first_of(work: RodWork, i: int) -> int:
    """Return the first of the three particles of twist joint i; for a joint with a wall, of those at that end."""
    return int(min(max(i - work.first_joint, 0), work.position.shape[0] - 3))


@inlined_kernel
def add_turns(work: RodWork) -> None:
    """Add the forces that resist the twist of joints."""
    for i in range(work.turn.shape[0]):
        first, turn = first_of(work, i), work.turn[i]
        strain = joint_strain(turn, work.position, first) - work.turned[i]
        if work.is_middle:
            strain += joint_strain(turn, work.lead[1], first)
        add_joint_force(turn, strain, first, work.force)


@inlined_kernel
def add_turns_tangent(work: RodWork, scale: float) -> None:
    """Add the tangent of these forces, times ``scale``."""
    for i in range(work.turn.shape[0]):
        add_rank_one(work.band, 3 * first_of(work, i), work.turn[i], scale)
