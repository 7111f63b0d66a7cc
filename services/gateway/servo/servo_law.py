r"""The force law of the servo, a pure function without clock, bus or device.

Forces on a hand are bounded only here, in this order: model, norm, rate, energy.

* A model is used unchanged up to an age of 5 ms (or a quarter of its life if that is shorter); then its elastic part
  fades, then its damping.
* For any model, :math:`|f| \le R (T - a)` with the rate limit R, the model's life T and its age a: the force is never
  larger than can still be removed, so it reaches zero at T without a step.
* Force rises, and changes direction, at most at the rate limit. It falls as fast as the spring that the hand unloads,
  as a force that outlasts its contact would push the withdrawing hand.
* It returns no more energy than all hands have put in, however late it reaches the motors, see `energy_bound`. If it
  comes later than those books cover, it fades.

A grasp torque obeys the same rules on its one axis.
"""

from __future__ import annotations

import math

from trocar.protocol.bodies.haptics import (
    MODEL_ANGLE0,
    MODEL_B,
    MODEL_CONTACT,
    MODEL_F0,
    MODEL_GRASP_B,
    MODEL_GRASP_K,
    MODEL_K,
    MODEL_RATE0,
    MODEL_TORQUE,
    MODEL_V0,
    MODEL_X0,
)
from trocar.services.gateway.servo.energy_bound import book_work, bound_force, settle_energy, take_as_put_in
from trocar.services.gateway.servo.servo_arrays import (
    HANDLE_ANGLE,
    HANDLE_RATE,
    LIMIT_ARM,
    LIMIT_CONTINUOUS_FORCE,
    LIMIT_FORCE,
    LIMIT_HANDLE,
    LIMIT_RATE,
    LIMIT_TORQUE,
    LIMIT_TORQUE_RATE,
    MEMORY_DEMAND,
    MEMORY_FORCE,
    MEMORY_HOT,
    MEMORY_REFUSED,
    MEMORY_SCALE,
    MEMORY_STIFFNESS,
    MEMORY_TORQUE,
    MEMORY_UNKNOWN,
    NOW_AGE,
    NOW_DT,
    NOW_GAIN,
    NOW_GRASP_GAIN,
    NOW_TEMPERATURE,
    NOW_TTL,
)
from trocar.services.gateway.servo.slew import slew, slew_vector
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, dot, scaled

#: A model is used unchanged up to this age, and up to this share of its life, so that a few lost ticks of haptics are
#: not felt, and of a life of 20 ms three quarters are left to fade in.
HOLD_S, HOLD_SHARE = 0.005, 0.25
#: Share of the rest of its life in which the elastic part fades; the damping fades in the remainder, as a spring
#: without damping would bounce.
ELASTIC_FADE = 2.0 / 3.0
#: A motor warmer than the first is limited to its continuous force until it is cooler than the second.
HOT, COOL = 0.7, 0.5
#: Longest time for the rate limit, so that a late tick does not allow a larger step.
MAX_STEP_S = 0.003
#: The same for a torque: one tick, although handles take turns, because shut jaws once lost all their 48 mN m in one
#: late exchange. With two handles in turn the fall of more than half of the largest torque takes up to 40 ms, against
#: 20 ms of a model's life; a drive disarms itself after 50 ms.
MAX_TORQUE_STEP_S = 0.001
#: Below this force the hand is free, as the rate limit makes forces outlast their contact by some ticks.
LIMP_N = 1e-3


@kernel
def hold_s(ttl_s: float) -> float:
    """Return the age up to which a model is used unchanged."""
    return min(HOLD_S, HOLD_SHARE * ttl_s)


@kernel
def elastic_share(age_s: float, ttl_s: float) -> float:
    """Return the gain of a model's elastic part at `age_s`: 1, then linearly down to 0."""
    fade = ELASTIC_FADE * (ttl_s - hold_s(ttl_s))
    return min(1.0, max(0.0, 1.0 - (age_s - hold_s(ttl_s)) / fade))


@kernel
def damping_share(age_s: float, ttl_s: float) -> float:
    """Return the gain of a model's damping at `age_s`: it outlasts the elastic part, and is 0 at `ttl_s`."""
    fade = (1.0 - ELASTIC_FADE) * (ttl_s - hold_s(ttl_s))
    return min(1.0, max(0.0, (ttl_s - age_s) / fade))


@kernel
def servo_force(model: FloatArray, motion: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray) -> None:
    """Write the force of this tick into `memory`; `servo_arrays` defines the columns.

    Args:
        model: (MODEL_COLUMNS,)
        motion: (6,). Position in m and velocity in m/s of the HIP, in the frame of the model.
        limits, now: (LIMIT_SIZE,), (NOW_SIZE,)
        memory: (MEMORY_SIZE,). The last force, position and energy, changed in place. A force that is not finite is
            counted in ``MEMORY_REFUSED`` and taken as zero.
    """
    own = limits[LIMIT_ARM:LIMIT_HANDLE]
    way = book_work((motion[0], motion[1], motion[2]), own, now, memory)
    settle_energy(way, own, now, _is_free(model, now, memory), memory)
    elastic = elastic_share(now[NOW_AGE], now[NOW_TTL])
    damping = damping_share(now[NOW_AGE], now[NOW_TTL])
    x = model_force(model, motion, 0, elastic, damping)
    y = model_force(model, motion, 1, elastic, damping)
    z = model_force(model, motion, 2, elastic, damping)
    demand = math.sqrt(x * x + y * y + z * z)
    if not math.isfinite(demand):
        memory[MEMORY_REFUSED] += 1.0
        x, y, z, demand = 0.0, 0.0, 0.0, 0.0
    gain = now[NOW_GAIN] if memory[MEMORY_UNKNOWN] == 0.0 else 0.0
    wanted = (gain * x, gain * y, gain * z)
    memory[MEMORY_DEMAND] = demand
    memory[MEMORY_SCALE] = gain * elastic
    _unload(model, way, wanted, memory)
    _approach(wanted, _largest_force(limits, now, memory), limits[LIMIT_RATE] * min(now[NOW_DT], MAX_STEP_S), memory)
    bound_force(way, own, now, memory)


@kernel
def servo_torque(
    model: FloatArray, handle: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray
) -> None:
    """Write the grasp torque of this tick into `memory`: the same law on one axis.

    Jaws may hold something when a torque begins: while it is ramped up, what is squeezed then counts as put in.
    """
    books, own = memory[MEMORY_TORQUE:], limits[LIMIT_HANDLE:]
    way = book_work((handle[HANDLE_ANGLE], 0.0, 0.0), own, now, books)
    gain = now[NOW_GRASP_GAIN] if books[MEMORY_UNKNOWN] == 0.0 else 0.0
    touches = model[MODEL_TORQUE] != 0.0 or model[MODEL_GRASP_K] != 0.0
    settle_energy(way, own, now, not touches or gain == 0.0, books)
    elastic = elastic_share(now[NOW_AGE], now[NOW_TTL])
    damping = damping_share(now[NOW_AGE], now[NOW_TTL])
    spring = model[MODEL_TORQUE] - model[MODEL_GRASP_K] * (handle[HANDLE_ANGLE] - model[MODEL_ANGLE0])
    if 0.0 < gain < 1.0 and model[MODEL_GRASP_K] > 0.0 and math.isfinite(spring):
        take_as_put_in(0.5 * min(abs(spring), limits[LIMIT_TORQUE]) ** 2 / model[MODEL_GRASP_K], books)
    friction = model[MODEL_GRASP_B] * (handle[HANDLE_RATE] - elastic * model[MODEL_RATE0])
    wanted = gain * (elastic * spring - damping * friction)
    if not math.isfinite(wanted):
        memory[MEMORY_REFUSED] += 1.0
        wanted = 0.0
    rate = limits[LIMIT_TORQUE_RATE]
    largest = min(limits[LIMIT_TORQUE], rate * max(0.0, now[NOW_TTL] - now[NOW_AGE]))
    step = rate * min(now[NOW_DT], MAX_TORQUE_STEP_S)
    wanted = min(max(wanted, -largest), largest)
    books[MEMORY_FORCE] = slew(books[MEMORY_FORCE], wanted, step)
    bound_force(way, own, now, books)


@kernel
def model_force(model: FloatArray, motion: FloatArray, axis: int, elastic: float, damping: float) -> float:
    """Return the force of a model along an axis, N, with these gains of its elastic part and damping."""
    spring, friction = model[MODEL_F0 + axis], 0.0
    for j in range(3):
        spring -= model[MODEL_K + 3 * axis + j] * (motion[j] - model[MODEL_X0 + j])
        # An old reference velocity would push; it fades with the elastic part, so that the remaining damping only
        # brakes.
        friction += model[MODEL_B + 3 * axis + j] * (motion[3 + j] - elastic * model[MODEL_V0 + j])
    return float(elastic * spring - damping * friction)


@kernel
def _unload(model: FloatArray, way: Vector, wanted: Vector, memory: FloatArray) -> None:
    """Reduce the force to the desired one along it, as fast as the spring that the hand unloads."""
    force = (memory[MEMORY_FORCE], memory[MEMORY_FORCE + 1], memory[MEMORY_FORCE + 2])
    held = math.sqrt(dot(force, force))
    if held == 0.0:
        memory[MEMORY_STIFFNESS] = 0.0
        return
    if model[MODEL_CONTACT] != 0.0:
        stiffness = 0.0
        for i in range(3):
            for j in range(3):
                stiffness += force[i] * model[MODEL_K + 3 * i + j] * force[j]
        memory[MEMORY_STIFFNESS] = stiffness / (held * held)
    unloaded = memory[MEMORY_STIFFNESS] * dot(way, force) / held
    fall = min(unloaded, held - max(0.0, dot(wanted, force) / held))
    if fall > 0.0:
        for i in range(3):
            memory[MEMORY_FORCE + i] = force[i] * (held - fall) / held


@kernel
def _is_free(model: FloatArray, now: FloatArray, memory: FloatArray) -> bool:
    """Return whether there is no contact, and no force left from one."""
    held = abs(memory[MEMORY_FORCE]) + abs(memory[MEMORY_FORCE + 1]) + abs(memory[MEMORY_FORCE + 2])
    return bool((model[MODEL_CONTACT] == 0.0 or now[NOW_GAIN] == 0.0) and held < LIMP_N)


@kernel
def _largest_force(limits: FloatArray, now: FloatArray, memory: FloatArray) -> float:
    if now[NOW_TEMPERATURE] > HOT:
        memory[MEMORY_HOT] = 1.0
    elif now[NOW_TEMPERATURE] < COOL:
        memory[MEMORY_HOT] = 0.0
    largest = limits[LIMIT_CONTINUOUS_FORCE] if memory[MEMORY_HOT] > 0.0 else limits[LIMIT_FORCE]
    return float(min(largest, limits[LIMIT_RATE] * max(0.0, now[NOW_TTL] - now[NOW_AGE])))


@kernel
def _approach(wanted: tuple[float, float, float], largest: float, step: float, memory: FloatArray) -> None:
    """Move the written force towards `wanted` by at most `step`, first back into the ball of radius `largest`.

    With start and target in the ball, every point between them is.
    """
    norm = math.sqrt(wanted[0] ** 2 + wanted[1] ** 2 + wanted[2] ** 2)
    target = scaled(wanted, largest / norm) if norm > largest else wanted
    force = (memory[MEMORY_FORCE], memory[MEMORY_FORCE + 1], memory[MEMORY_FORCE + 2])
    held = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    back = min(max(0.0, held - largest), step)
    if back > 0.0:
        force = scaled(force, (held - back) / held)
    force = slew_vector(force, target, step - back)
    for axis in range(3):
        memory[MEMORY_FORCE + axis] = force[axis]
