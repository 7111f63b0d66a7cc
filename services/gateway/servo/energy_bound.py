r"""Bound on the energy returned to hands: at most what all hands of the gateway together have put in.

A force held over a displacement has done the work :math:`f_{k-1} \cdot (x_k - x_{k-1})`, whatever the model and its
age (Hannaford and Ryu, IEEE Trans. Robotics and Automation 18(1), 2002). Each servo accounts for it: energy put in
counts fully, energy returned less the share dissipated by the friction that the arm surely has. As one hand may push
another through tissue, the sum over all arms counts. A handle is bounded by its own balance, on one axis.

A force reaches the motors some time after the position that it answers was read, and until then the force before it
acts. How long is known only as an interval: from nothing up to :math:`\tau`, the measured time from reading to
writing and the longest that the device's own interface adds, and anew for each force. So the books are of an interval,
too: with :math:`\sigma_j`, the longest share of the tick for which the force j ticks before may not have come, up to

.. math:: f_{k-1} \cdot s_k + \sum_j \sigma_j \max(0, \Delta_j \cdot s_k, \Delta_j \cdot s_{k-1}), \qquad
    \Delta_j = f_{k-1-j} - f_{k-j},

is returned: the worst delay, at the speed of this or of the last tick. `FLIGHTS` forces may be under way; beyond, what
a hand is given is not known, and the law lets go.

Where a device answers through another program, a force is not sent while that has not answered the one before. A force
that was not sent has not come, for the whole tick, and comes with the next that is sent, which replaces it; nor is the
one that was not answered known to have come. So while r forces in a row are not sent, :math:`\sigma = 1` for the last
r + 1, and afterwards no r of them is earlier than the newest.

Friction that no motion has been charged for yet pays debts: where nothing was returned, it has taken F s of the hand.
An arm that surely has none could never begin to push, as no hand puts energy into no force: so `ADVANCE_J` is available
at first, once.

A reading may flicker by a count in each coordinate while the tip stands still and nothing is dissipated. So the work is
accounted for twice, step by step and directly from an *anchor*, the last position that was further than a flicker from
the anchor before. The smaller energy counts; on one way both agree.

The next force acts over a displacement that is not known yet, and over a part :math:`\rho = \tau / T` of the one after.
If the hand moves by :math:`s` along it in a tick, it receives :math:`(1 + \rho)(f - F)\,s` beyond the friction
:math:`F`, and what the forces under way, f' the newest of them, give beyond f. So

.. math:: f \le F + \min\left(\frac{E}{(1 + \rho)\,s}, \frac{E}{s} - \rho\,(f' - F)\right), \qquad
    s = \max(0, s_k + j, 2 s_k - s_{k-1}) + 2 q,

with the available energy E (not below 0), and the displacements :math:`s_k` along the force, extrapolated linearly, or
by the most :math:`j` that this hand's displacement has changed by from tick to tick of late, less what readings
flicker: who snaps once may snap again.
What the forces of other hands, and older ones of this hand, may still return is not available. A position is known to
a count q, so a displacement to two. A force below the friction is never reduced. Nor is that of a hand that presses or
withdraws slowly, except within some counts of the surface, in walls up to :math:`K = F/q`. In a stiffer wall each count
to and fro, as of a hand at rest on the edge of one, really returns :math:`(K q - F)\,q`.
docs/explanation/gateway.md derives it.
"""

from __future__ import annotations

import math

from trocar.services.gateway.servo.servo_arrays import (
    FLIGHT_LEFT,
    FLIGHT_SIZE,
    FLIGHTS,
    MEMORY_ANCHOR,
    MEMORY_AT_ANCHOR,
    MEMORY_BY_STEPS,
    MEMORY_ENERGY,
    MEMORY_FLIGHTS,
    MEMORY_FORCE,
    MEMORY_POSITION,
    MEMORY_RESERVED,
    MEMORY_RETURNED,
    MEMORY_SKIPPED,
    MEMORY_SUDDEN,
    MEMORY_UNKNOWN,
    MEMORY_WAY,
    NOW_DT,
    NOW_LAST_LATE_S,
    NOW_LATE_S,
    NOW_OTHERS,
    NOW_RESERVED,
    NOW_SKIPPED,
    OWN_COUNT,
    OWN_FRICTION,
    OWN_SUDDEN,
)
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, dot, scaled, subtract, unit

#: What a hand may be given in advance where no friction is sure, J, as no force could begin; and how fast any debt is
#: forgiven, W.
ADVANCE_J, FORGIVEN_W = 2e-7, 2e-8
#: Square of a displacement in counts that needs a moving tip: between three coordinates of one count, and one of two.
FLICKER = 3.5
#: Limit of stored energy, so that long friction does not pay for a later burst.
MAX_STORED_J = 0.05
#: Change of a displacement, in counts, that is no more than a flicker of three readings; and for how long a larger one
#: is remembered.
FLICKERS, SUDDEN_S = 4.0, 2.0
#: Over a tick as late as this a hand goes far without being sudden.
LATE_TICK_S = 0.003
#: A tick that seems shorter than this is none to measure delays by.
_SHORTEST_TICK_S = 1e-5


@kernel
def book_work(place: Vector, own: FloatArray, now: FloatArray, memory: FloatArray) -> Vector:
    """Account for the most that the forces held may have done up to a place; return the displacement, m.

    Args:
        place: Position in m, or an angle in rad on the first axis.
        own: (OWN_SIZE,), the limits of this arm or handle.
        now: (NOW_SIZE,)
        memory: (BOOKS_SIZE,) or longer.
    """
    way, apart = subtract(place, _at(memory, MEMORY_POSITION)), subtract(place, _at(memory, MEMORY_ANCHOR))
    force, friction = _at(memory, MEMORY_FORCE), own[OWN_FRICTION]
    late = _late_work(force, way, now, memory)
    work = dot(force, way) + late
    memory[MEMORY_RETURNED] = 1.0 if work > 0.0 else 0.0
    by_steps = min(memory[MEMORY_BY_STEPS] - _given(work, way, friction), MAX_STORED_J)
    energy = min(by_steps, memory[MEMORY_AT_ANCHOR] - _given(dot(force, apart) + late, apart, friction))
    if not math.isfinite(energy):
        energy = by_steps = 0.0
    if dot(apart, apart) > FLICKER * own[OWN_COUNT] ** 2:
        memory[MEMORY_AT_ANCHOR] = by_steps = energy
        _put(place, memory, MEMORY_ANCHOR)
    memory[MEMORY_ENERGY], memory[MEMORY_BY_STEPS] = energy, by_steps
    _put(place, memory, MEMORY_POSITION)
    return way


@kernel
def settle_energy(way: Vector, own: FloatArray, now: FloatArray, free: bool, memory: FloatArray) -> None:
    """Close the balance of a contact when the hand is `free`, and let friction pay a common debt.

    A contact begins without credit, except for that used by other hands, and with any remaining debt. Over a
    displacement on which nothing was returned friction has taken what it takes of a hand, which nobody has counted yet.
    """
    others, energy = now[NOW_OTHERS], memory[MEMORY_ENERGY]
    if free:
        energy = min(energy, max(0.0, -others))
    owed = min(-energy, -energy - others)
    if owed > 0.0:
        rubbed = own[OWN_FRICTION] * math.sqrt(dot(way, way)) if memory[MEMORY_RETURNED] == 0.0 else 0.0
        energy += min(owed, rubbed + FORGIVEN_W * _tick_s(now))
    _set_energy(energy, memory)


@kernel
def take_as_put_in(energy: float, memory: FloatArray) -> None:
    """Open the books with at least this energy, J: what a hand holds already when its force begins."""
    _set_energy(max(energy, memory[MEMORY_ENERGY]), memory)


@kernel
def bound_force(way: Vector, own: FloatArray, now: FloatArray, memory: FloatArray) -> None:
    """Scale down the force in `memory` so that until it is replaced no more than the available energy is returned.

    What may be returned is reserved: two hands that draw back in one tick do not spend the same energy.
    """
    force, before = _at(memory, MEMORY_FORCE), _at(memory, MEMORY_WAY)
    held, along = math.sqrt(dot(force, force)), _direction(memory)
    _put(way, memory, MEMORY_WAY)
    out = dot(way, along)
    tick_s, friction = _tick_s(now), own[OWN_FRICTION]
    sudden = _sudden(subtract(way, before), own, tick_s, memory)
    ahead = max(0.0, out + sudden, 2.0 * out - dot(before, along)) + 2.0 * own[OWN_COUNT]
    share = now[NOW_LATE_S] / tick_s
    older = _older_work(along, ahead, tick_s, memory)
    advance = ADVANCE_J if friction == 0.0 else 0.0
    available = max(0.0, advance + memory[MEMORY_ENERGY] + now[NOW_OTHERS] - now[NOW_RESERVED] - older)
    acting = max(0.0, dot(_at(memory, MEMORY_FLIGHTS), along) - friction)
    beyond = max(0.0, min(available / ahead / (1.0 + share), available / ahead - share * acting))
    if friction + beyond < held:
        force = scaled(force, (friction + beyond) / held)
        _put(force, memory, MEMORY_FORCE)
    beyond = min(beyond, max(0.0, held - friction))
    memory[MEMORY_RESERVED] = older + (beyond + share * max(beyond, acting)) * ahead


@kernel
def _set_energy(energy: float, memory: FloatArray) -> None:
    """Change all balances alike."""
    change = energy - memory[MEMORY_ENERGY]
    memory[MEMORY_ENERGY] = energy
    memory[MEMORY_BY_STEPS] += change
    memory[MEMORY_AT_ANCHOR] += change


@kernel
def _late_work(force: Vector, way: Vector, now: FloatArray, memory: FloatArray) -> float:
    """Return what forces that were under way may have given beyond the held one, J, and put that one under way."""
    work, before, replaced, tick_s = 0.0, _at(memory, MEMORY_WAY), force, _tick_s(now)
    memory[MEMORY_FLIGHTS + FLIGHT_LEFT] = now[NOW_LAST_LATE_S]
    _delay_skipped(now, memory)
    for k in range(FLIGHTS):
        first = MEMORY_FLIGHTS + FLIGHT_SIZE * k
        older, left = _at(memory, first), memory[first + FLIGHT_LEFT]
        change = subtract(older, replaced)
        work += min(1.0, left / tick_s) * max(0.0, dot(change, way), dot(change, before))
        memory[first + FLIGHT_LEFT] = max(0.0, left - tick_s)
        replaced = older
    last = MEMORY_FLIGHTS + FLIGHT_SIZE * (FLIGHTS - 1)
    is_late = memory[last + FLIGHT_LEFT] > 0.0 or now[NOW_SKIPPED] > FLIGHTS - 1
    memory[MEMORY_UNKNOWN] = 1.0 if is_late else 0.0
    for place in range(last - 1, MEMORY_FLIGHTS - 1, -1):
        memory[place + FLIGHT_SIZE] = memory[place]
    _put(force, memory, MEMORY_FLIGHTS)
    return work


@kernel
def _delay_skipped(now: FloatArray, memory: FloatArray) -> None:
    """Delay forces that were not sent, and the one before them that was not answered; see the module."""
    skipped = int(now[NOW_SKIPPED])
    least_s = _tick_s(now) if skipped else now[NOW_LAST_LATE_S]
    for k in range(1, min(FLIGHTS - 1, skipped or int(memory[MEMORY_SKIPPED])) + 1):
        left = MEMORY_FLIGHTS + FLIGHT_SIZE * k + FLIGHT_LEFT
        memory[left] = max(memory[left], least_s)
    memory[MEMORY_SKIPPED] = now[NOW_SKIPPED]


@kernel
def _sudden(change: Vector, own: FloatArray, tick_s: float, memory: FloatArray) -> float:
    """Return the most by which a displacement has changed of late under a force, and remember it.

    A late tick says nothing of it, nor does one without force: a reading that comes back is no hand that snaps.
    """
    acted, newest = _at(memory, MEMORY_FLIGHTS), 0.0
    if tick_s < LATE_TICK_S and dot(acted, acted) > 0.0:
        newest = math.sqrt(dot(change, change)) - FLICKERS * own[OWN_COUNT]
    kept = memory[MEMORY_SUDDEN] * max(0.0, 1.0 - tick_s / SUDDEN_S)
    memory[MEMORY_SUDDEN] = max(newest, kept, own[OWN_SUDDEN])
    return float(memory[MEMORY_SUDDEN])


@kernel
def _older_work(along: Vector, ahead: float, tick_s: float, memory: FloatArray) -> float:
    """Return what forces before the last may still give beyond it over `ahead` in a tick, J."""
    work = 0.0
    for k in range(1, FLIGHTS):
        first = MEMORY_FLIGHTS + FLIGHT_SIZE * k
        change = subtract(_at(memory, first), _at(memory, first - FLIGHT_SIZE))
        work += memory[first + FLIGHT_LEFT] / tick_s * max(0.0, dot(change, along)) * ahead
    return work


@kernel
def _direction(memory: FloatArray) -> Vector:
    """Return the direction of the force, or where it is zero, of the newest that is not and may be under way."""
    along = unit(_at(memory, MEMORY_FORCE))
    for k in range(FLIGHTS):
        if along[0] != 0.0 or along[1] != 0.0 or along[2] != 0.0:
            break
        along = unit(_at(memory, MEMORY_FLIGHTS + FLIGHT_SIZE * k))
    return along


@kernel
def _given(work: float, way: Vector, friction: float) -> float:
    """Return the energy that the hand receives of the work over a displacement, J, negative if it puts some in."""
    moved = math.sqrt(dot(way, way))
    if work <= 0.0 or moved == 0.0:
        return float(work)
    return float(max(0.0, work - friction * moved))


@kernel
def _tick_s(now: FloatArray) -> float:
    return float(max(now[NOW_DT], _SHORTEST_TICK_S))


@kernel
def _at(memory: FloatArray, first: int) -> Vector:
    """Return a stored vector."""
    return (memory[first], memory[first + 1], memory[first + 2])


@kernel
def _put(vector: Vector, memory: FloatArray, first: int) -> None:
    """Store a vector."""
    for axis in range(3):
        memory[first + axis] = vector[axis]
