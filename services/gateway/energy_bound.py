r"""What a hand may get back: at most what all hands of the gateway together have put in.

A force that was held on a way has given the work :math:`f_{k-1} \cdot (x_k - x_{k-1})`, exactly, whatever the model
said and however late it was (Hannaford and Ryu, IEEE Trans. Robotics and Automation 18(1), 2002). Each servo books it:
what is put in whole, what is given less what the arm's own friction took of it. Through tissue a hand may push
another, so what counts is the sum over all servos.

The next force is held before anybody sees the way. Let the hand go :math:`s` along it: the hand gets
:math:`(f - F)\,s` past the friction :math:`F`, so

.. math:: f \le F + \frac{E}{s}, \qquad s = \max(0, s_k, 2 s_k - s_{k-1}) + 2 q,

with the energy E that is there (not below 0) and the ways :math:`s_k` along the force, carried on evenly; a position is
known to a count q, so a way to two. A force below the friction is never touched. Nor is that of a hand that presses or
draws back slowly, but within four counts of the surface, in walls up to :math:`K = F/q`: of a stiffer one each count to
and fro, as of a hand that rests on the edge of one, gives :math:`(K q - F)\,q` in earnest.
docs/explanation/gateway.md derives it.
"""

from __future__ import annotations

import math

from services.gateway.servo_arrays import (
    LIMIT_COUNT,
    LIMIT_FRICTION,
    MEMORY_ENERGY,
    MEMORY_FORCE,
    MEMORY_POSITION,
    MEMORY_WAY,
    NOW_DT,
    NOW_OTHERS,
)
from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, dot, scaled

#: What is owed by all is forgiven by and by, as the arms' own friction takes more: nobody stays limp.
FORGIVEN_S = 1.0
#: Energy that is remembered: long friction must not pay for a later burst.
MAX_STORED_J = 0.05


@kernel
def book_work(motion: FloatArray, limits: FloatArray, memory: FloatArray) -> Vector:
    """Book what the held force did on the way to the pose of `motion`; return the way, m."""
    way = (
        motion[0] - memory[MEMORY_POSITION],
        motion[1] - memory[MEMORY_POSITION + 1],
        motion[2] - memory[MEMORY_POSITION + 2],
    )
    given = dot(_held(memory), way)
    if given > 0.0:
        given = max(0.0, given - limits[LIMIT_FRICTION] * math.sqrt(dot(way, way)))
    energy = memory[MEMORY_ENERGY] - given
    memory[MEMORY_ENERGY] = min(energy, MAX_STORED_J) if math.isfinite(energy) else 0.0
    for axis in range(3):
        memory[MEMORY_POSITION + axis] = motion[axis]
    return way


@kernel
def settle(now: FloatArray, free: bool, memory: FloatArray) -> None:
    """Close the book of a contact where the hand is `free`, and forgive some of what all together owe.

    A contact begins without savings, but for those that others have drawn on, and with what is still owed.
    """
    others, energy = now[NOW_OTHERS], memory[MEMORY_ENERGY]
    if free:
        energy = min(energy, max(0.0, -others))
    owed = min(-energy, -energy - others)
    if owed > 0.0:
        energy += owed * min(1.0, now[NOW_DT] / FORGIVEN_S)
    memory[MEMORY_ENERGY] = energy


@kernel
def bound_force(way: Vector, limits: FloatArray, now: FloatArray, memory: FloatArray) -> None:
    """Let the force in `memory` give no more on the way of the next tick than is there: it falls along itself."""
    force = _held(memory)
    held = math.sqrt(dot(force, force))
    before = (memory[MEMORY_WAY], memory[MEMORY_WAY + 1], memory[MEMORY_WAY + 2])
    for axis in range(3):
        memory[MEMORY_WAY + axis] = way[axis]
    if held == 0.0:
        return
    out, out_before = dot(way, force) / held, dot(before, force) / held
    ahead = max(0.0, out, 2.0 * out - out_before) + 2.0 * limits[LIMIT_COUNT]
    largest = limits[LIMIT_FRICTION] + max(0.0, memory[MEMORY_ENERGY] + now[NOW_OTHERS]) / ahead
    if largest < held:
        force = scaled(force, largest / held)
        for axis in range(3):
            memory[MEMORY_FORCE + axis] = force[axis]


@kernel
def _held(memory: FloatArray) -> Vector:
    return (memory[MEMORY_FORCE], memory[MEMORY_FORCE + 1], memory[MEMORY_FORCE + 2])
