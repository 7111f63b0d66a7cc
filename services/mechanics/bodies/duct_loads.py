"""Kernels of the duct's contact loads: gather contact points, apply forces to modes and nodes."""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.node_compliance import NodeArrays, gather_and_displace
from trocar.services.mechanics.reduction.residual.node_numbering import forget_numbers, number_node
from trocar.services.mechanics.rod.free_step import FreeStep, step_at


class DuctMotion(Struct):
    """The modes from the start of a step to its end without contact forces, and their loads."""

    q: Annotated[FloatArray, "r"]
    qdot: Annotated[FloatArray, "r"]
    qddot: Annotated[FloatArray, "r"]
    start: Annotated[FloatArray, "r"]
    change: Annotated[FloatArray, "r"]
    constant: Annotated[FloatArray, "r"]  # loads in every step
    force: Annotated[FloatArray, "r"]
    held: Annotated[FloatArray, "r"]  # part of it that is the same over all of the step
    removed_half_impulse: Annotated[FloatArray, "r"]
    before: Annotated[FloatArray, "r"]  # rates at the start of the step
    taken: Annotated[FloatArray, "r"]  # change of those at its end, see `pay_for_impulses`


motion_at = reader(DuctMotion)


class DuctLoads(Struct):
    """Contact points, loaded nodes, and the modal contact force of a step."""

    free: DuctMotion
    gains: Annotated[FloatArray, 3, "r"]  # change of q, qdot and qddot per modal contact force
    impulse: Annotated[FloatArray, "r"]  # the modal contact force
    last: Annotated[FloatArray, "r"]  # that of the last step
    damping: Annotated[FloatArray, "r"]  # 2 zeta omega
    debt: Annotated[FloatArray, 1]  # in J, see `pay_for_impulses`
    modes: Annotated[FloatArray, "3 c", "r"]
    displacement: Annotated[FloatArray, "c", 3]
    motion: Annotated[FloatArray, "c", 3]
    node: Annotated[IntArray, "l"]
    force: Annotated[FloatArray, "l", 3]
    count: Annotated[LongArray, 2]  # of nodes with loads, and of those that contacts of this step load
    slot: Annotated[IntArray, "n"]  # scratch, all -1


loads_at = reader(DuctLoads)


@kernel
def begin_duct_loads(address: Address[DuctMotion]) -> None:
    """Reset the modal loads to the constant ones."""
    duct = motion_at(address)
    for mode in range(duct.force.shape[0]):
        duct.force[mode] = duct.constant[mode]


@kernel
def hold_force(address: Address[DuctMotion], last: FloatArray, force: FloatArray) -> None:
    """Hold ``force`` (r,) over the step in place of ``last`` (r,), see `DuctBody.hold`."""
    duct = motion_at(address)
    for mode in range(force.shape[0]):
        change = force[mode] - last[mode]
        duct.qddot[mode] += change
        duct.held[mode] += change
        duct.force[mode] += force[mode]
        last[mode] = force[mode]


@kernel
def begin_loads(duct_address: Address[DuctMotion], catheter_address: Address[FreeStep]) -> None:
    """Reset the loads of duct and catheter to the constant ones."""
    begin_duct_loads(duct_address)
    catheter = step_at(catheter_address)
    for i in range(catheter.external.shape[0]):
        for axis in range(3):
            catheter.external[i, axis] = catheter.constant[i, axis]


@inlined_kernel
def gather_kept(duct: DuctLoads, kept: Address[NodeArrays], nodes: IntArray, weights: FloatArray) -> bool:
    """Do as `DuctBody.gather` for points (k, 3); if a node is not cached, leave residuals out and return False."""
    n, count, free = nodes.shape[0], duct.count[0], duct.free
    loads, out = (duct.node[:count], duct.force[:count]), (duct.modes[: 3 * n], duct.displacement[:n], duct.motion[:n])
    return bool(gather_and_displace(kept, (nodes, weights), (free.start, free.change), loads, out))


@kernel
def correct(address: Address[DuctLoads], nodes: IntArray, weights: FloatArray, forces: FloatArray, dt_s: float) -> None:
    """Apply the reactions to ``forces`` (k, 3) at barycentric points (k, 3); see `DuctBody.correct`."""
    out = loads_at(address)
    out.count[0] = out.count[1] = _spread_loads(nodes, weights, forces, out)
    _write_modal_force(out, forces)
    _add_impulse(out)
    pay_for_impulses(out, dt_s)


@inlined_kernel
def _spread_loads(nodes: IntArray, weights: FloatArray, forces: FloatArray, out: DuctLoads) -> int:
    """Write the reactions on the duct's nodes, each node once, and return their number."""
    load_nodes, loads, slot = out.node, out.force, out.slot
    count = 0
    for row in range(forces.shape[0]):
        if forces[row, 0] == 0.0 and forces[row, 1] == 0.0 and forces[row, 2] == 0.0:
            continue
        for corner in range(3):
            weight = weights[row, corner]
            if weight == 0.0:
                continue
            place = number_node(nodes[row, corner], slot, load_nodes, count)
            if place == count:
                loads[place] = 0.0
                count += 1
            for axis in range(3):
                loads[place, axis] -= weight * forces[row, axis]
    forget_numbers(slot, load_nodes, count)
    return count


@inlined_kernel
def _write_modal_force(out: DuctLoads, forces: FloatArray) -> None:
    """Write the modal force (r,) of the reactions to ``forces`` (k, 3)."""
    modes, impulse = out.modes, out.impulse
    for mode in range(impulse.shape[0]):
        out.last[mode], impulse[mode] = impulse[mode], 0.0
    for row in range(forces.shape[0]):
        for axis in range(3):
            force = forces[row, axis]
            if force != 0.0:
                for mode in range(impulse.shape[0]):
                    impulse[mode] -= modes[3 * row + axis, mode] * force


@inlined_kernel
def _add_impulse(out: DuctLoads) -> None:
    """Add the effect of the modal contact force to the state at the end of the step."""
    gains, force, state = out.gains, out.impulse, out.free
    for mode in range(force.shape[0]):
        state.q[mode] += gains[0, mode] * force[mode]
        state.qdot[mode] += gains[1, mode] * force[mode]
        state.qddot[mode] += gains[2, mode] * force[mode]


@inlined_kernel
def pay_for_impulses(out: DuctLoads, dt_s: float) -> None:
    r"""Remove from the rates the energy that contact impulses added beyond their work and beyond damping.

    A force f that acts as an impulse at the start of a step takes the work :math:`f \Delta x` from the pressing body,
    but changes the energy of a mode, taken at its `DuctBody.rate`, by

    .. math:: f \Delta x + \Delta f \, (v + (f + f_0) \Delta t / 4) \, \Delta t / 2

    with :math:`f_0` the last step's force and v the rate at the start of the step. A steady force adds no excess. An
    alternating one, as occurs on modes that a step does not resolve, would keep the wall oscillating. The rates are
    scaled down by the excess; what they cannot cover becomes a debt to later steps.
    """
    state, force, gained_j, kinetic_j = out.free, out.impulse, out.debt[0], 0.0
    for mode in range(force.shape[0]):
        f, rate = dt_s * force[mode], state.qdot[mode]
        start, jumped = state.before[mode], state.before[mode] + state.removed_half_impulse[mode] + f
        held, mean = start + 0.5 * dt_s * out.last[mode], 0.5 * (jumped + rate)
        kinetic_j += 0.5 * (rate + 0.5 * f) ** 2
        gained_j += 0.5 * (jumped * jumped - held * held + f * (rate + 0.25 * f))
        gained_j -= force[mode] * (state.q[mode] - state.start[mode]) + dt_s * out.damping[mode] * mean * mean
    out.debt[0] = max(gained_j - kinetic_j, 0.0)
    paid = min(max(gained_j, 0.0) / kinetic_j, 1.0) if kinetic_j > 0.0 else 0.0
    for mode in range(force.shape[0]):
        change = (math.sqrt(1.0 - paid) - 1.0) * (state.qdot[mode] + 0.5 * dt_s * force[mode])
        state.taken[mode] = change
        state.qdot[mode] += change
        state.qddot[mode] -= out.damping[mode] * change
