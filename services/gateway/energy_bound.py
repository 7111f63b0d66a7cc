r"""Bound on the energy returned to hands: at most what all hands of the gateway together have put in.

A force held over a displacement has done the work :math:`f_{k-1} \cdot (x_k - x_{k-1})`, exactly, whatever the model
and its age (Hannaford and Ryu, IEEE Trans. Robotics and Automation 18(1), 2002). Each servo accounts for it: energy put
in counts fully, energy returned less the share dissipated by the arm's own friction. As one hand may push another
through tissue, the sum over all servos counts.

A reading may flicker by a count in each coordinate while the tip stands still and nothing is dissipated. So the work is
accounted for twice, step by step and directly from an *anchor*, the last position that was further than a flicker from
the anchor before. The smaller energy counts; on one way both agree.

The next force is held before its displacement is known. If the hand moves by :math:`s` along it, it receives
:math:`(f - F)\,s` beyond the friction :math:`F`, so

.. math:: f \le F + \frac{E}{s}, \qquad s = \max(0, s_k, 2 s_k - s_{k-1}) + 2 q,

with the available energy E (not below 0), and the displacements :math:`s_k` along the force, extrapolated linearly.
What the forces of other hands may still return is not available. A position is known to a count q, so a displacement to
two. A force below the friction is never reduced. Nor is that of a hand that presses or withdraws slowly, except within
four counts of the surface, in walls up to :math:`K = F/q`. In a stiffer wall each count to and fro, as of a hand at
rest on the edge of one, really returns :math:`(K q - F)\,q`.
docs/explanation/gateway.md derives it.
"""

from __future__ import annotations

import math

from trocar.services.gateway.servo_arrays import (
    LIMIT_COUNT,
    LIMIT_FRICTION,
    MEMORY_ANCHOR,
    MEMORY_AT_ANCHOR,
    MEMORY_BY_STEPS,
    MEMORY_ENERGY,
    MEMORY_FORCE,
    MEMORY_POSITION,
    MEMORY_RESERVED,
    MEMORY_WAY,
    NOW_DT,
    NOW_OTHERS,
    NOW_RESERVED,
)
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, dot, scaled

#: Time constant by which a common debt is forgiven, so that no hand stays limp; the arms' friction dissipates more.
FORGIVEN_S = 1.0
#: Square of a displacement in counts that needs a moving tip: between three coordinates of one count, and one of two.
FLICKER = 3.5
#: Limit of stored energy, so that long friction does not pay for a later burst.
MAX_STORED_J = 0.05


@kernel
def book_work(motion: FloatArray, limits: FloatArray, memory: FloatArray) -> Vector:
    """Account for the work of the held force up to the pose of `motion`; return the displacement, m."""
    way, apart = _way_from(memory, MEMORY_POSITION, motion), _way_from(memory, MEMORY_ANCHOR, motion)
    force, friction = _held(memory), limits[LIMIT_FRICTION]
    by_steps = min(memory[MEMORY_BY_STEPS] - _given(force, way, friction), MAX_STORED_J)
    energy = min(by_steps, memory[MEMORY_AT_ANCHOR] - _given(force, apart, friction))
    if not math.isfinite(energy):
        energy = by_steps = 0.0
    if dot(apart, apart) > FLICKER * limits[LIMIT_COUNT] ** 2:
        memory[MEMORY_AT_ANCHOR] = by_steps = energy
        _put(motion, memory, MEMORY_ANCHOR)
    memory[MEMORY_ENERGY], memory[MEMORY_BY_STEPS] = energy, by_steps
    _put(motion, memory, MEMORY_POSITION)
    return way


@kernel
def settle(now: FloatArray, free: bool, memory: FloatArray) -> None:
    """Close the balance of a contact when the hand is `free`, and forgive a part of the common debt.

    A contact begins without credit, except for that used by other hands, and with any remaining debt.
    """
    others, energy = now[NOW_OTHERS], memory[MEMORY_ENERGY]
    if free:
        energy = min(energy, max(0.0, -others))
    owed = min(-energy, -energy - others)
    if owed > 0.0:
        energy += owed * min(1.0, now[NOW_DT] / FORGIVEN_S)
    change = energy - memory[MEMORY_ENERGY]
    memory[MEMORY_ENERGY] = energy
    memory[MEMORY_BY_STEPS] += change
    memory[MEMORY_AT_ANCHOR] += change


@kernel
def bound_force(way: Vector, limits: FloatArray, now: FloatArray, memory: FloatArray) -> None:
    """Scale down the force in `memory` so that the next tick returns no more than the available energy.

    What it may return is reserved: two hands that draw back in one tick do not spend the same energy.
    """
    force = _held(memory)
    held = math.sqrt(dot(force, force))
    before = (memory[MEMORY_WAY], memory[MEMORY_WAY + 1], memory[MEMORY_WAY + 2])
    for axis in range(3):
        memory[MEMORY_WAY + axis] = way[axis]
    memory[MEMORY_RESERVED] = 0.0
    if held == 0.0:
        return
    out, out_before = dot(way, force) / held, dot(before, force) / held
    ahead = max(0.0, out, 2.0 * out - out_before) + 2.0 * limits[LIMIT_COUNT]
    available = max(0.0, memory[MEMORY_ENERGY] + now[NOW_OTHERS] - now[NOW_RESERVED])
    largest = limits[LIMIT_FRICTION] + available / ahead
    memory[MEMORY_RESERVED] = max(0.0, min(held, largest) - limits[LIMIT_FRICTION]) * ahead
    if largest < held:
        force = scaled(force, largest / held)
        for axis in range(3):
            memory[MEMORY_FORCE + axis] = force[axis]


@kernel
def _given(force: Vector, way: Vector, friction: float) -> float:
    """Return the energy that the hand receives from a force over a displacement, J, negative if it puts some in."""
    given = dot(force, way)
    return max(0.0, given - friction * math.sqrt(dot(way, way))) if given > 0.0 else given


@kernel
def _way_from(memory: FloatArray, first: int, motion: FloatArray) -> Vector:
    """Return the displacement from a stored position to that of `motion`, m."""
    return (motion[0] - memory[first], motion[1] - memory[first + 1], motion[2] - memory[first + 2])


@kernel
def _put(motion: FloatArray, memory: FloatArray, first: int) -> None:
    """Store the position of `motion`."""
    for axis in range(3):
        memory[first + axis] = motion[axis]


@kernel
def _held(memory: FloatArray) -> Vector:
    return (memory[MEMORY_FORCE], memory[MEMORY_FORCE + 1], memory[MEMORY_FORCE + 2])
