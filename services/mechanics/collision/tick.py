"""The start of a tick of a deforming surface: its state taken over, and what the search tree is told of the motion.

What a search has found stays true until the wall has moved so and so far. A sum of all the changes since would grow
without end where the wall only trembles: contacts at rest do that by nanometres, and the bound of a node's motion by
the modes' energy makes micrometres a tick of them. So the change is counted from an anchor, a state of the past: with
D the distance of a state from the anchor, two states are no further apart than D + D'. A search notes the travel
up to the anchor *less* D, later the travel is that up to the anchor *plus* D', and their difference bounds the motion.
When the wall has left the anchor for good, the anchor follows.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.shell import Body, Shell, shell_at
from services.mechanics.collision.turned import note_turns
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import dot, row

#: A bound of motion at which the anchor follows: more than what trembles, little against the skin of the searches.
ANCHOR_M = 20e-6


@kernel
def start_tick(address: Address[Shell], q: FloatArray, nodes: IntArray, residuals: FloatArray) -> bool:
    """Take over q (r,) and the residuals (l, 3) of ``nodes`` (l,), and return whether they are sound."""
    return _take_state(shell_at(address).body, q, nodes, residuals)


@kernel
def end_turn(address: Address[Shell]) -> None:
    """Count what the sections of a turned wall have done in this tick, once they are where they are."""
    note_turns(shell_at(address).body)


@kernel
def _take_state(body: Body, q: FloatArray, nodes: IntArray, residuals: FloatArray) -> bool:
    """Take over q and the residuals if they are sound; add this tick's largest possible node motion to the travel."""
    omega, anchor, own = body.omega, body.anchor, body.q
    norm, unsound = 0.0, 0.0
    for k in range(omega.shape[0]):
        norm += (omega[k] * q[k]) ** 2
    moved, away = motion_between(body, q, anchor)
    for k in range(residuals.shape[0]):
        unsound += (residuals[k, 0] + residuals[k, 1] + residuals[k, 2]) * 0.0  # 0, or NaN where one is not finite
        if nodes[k] < 0 or nodes[k] >= body.rest.shape[0]:
            return False
    if not math.isfinite(norm + away + unsound):
        return False
    for k in range(omega.shape[0]):
        own[k] = q[k]
    body.tick += 1
    body.norm = math.sqrt(norm)
    body.energy_norm = body.norm * _grown(body, body.norm)
    grown = _grown(body, max(body.anchor_norm, body.norm))
    _count_travel(body, away * grown, moved * grown)
    body.residual_travel += _replace_residuals(body, nodes, residuals)
    body.travel = body.motion_travel + body.residual_travel
    body.travel_noted = body.motion_noted + body.residual_travel
    return True


@kernel
def motion_between(body: Body, q: FloatArray, other: FloatArray) -> tuple[float, float]:
    """Return how far two modal states (r,) are apart in any node of a straight wall, at most, and |omega (q - other)|.

    The softest node's bound by the energy of their difference; or, where that is less, the sum of the bounds by what
    each block of modes has of it: stiff modes have the energy of contacts that tremble, and move hardly anything.
    """
    omega, block, reach = body.omega, body.block, body.block_reach
    apart, energy = 0.0, 0.0
    for b in range(reach.shape[0]):
        part = 0.0
        for k in range(block[b], block[b + 1]):
            part += (omega[k] * (q[k] - other[k])) ** 2
        energy += part
        apart += reach[b] * math.sqrt(part)
    away = math.sqrt(energy)
    return min(apart, body.largest_reach * away), away


@kernel
def _count_travel(body: Body, away: float, moved: float) -> None:
    """Count energy travel and motion in a state this far from the anchor; let the anchor follow if that is far."""
    if body.largest_reach * away > ANCHOR_M:
        own, anchor = body.q, body.anchor
        for k in range(own.shape[0]):
            anchor[k] = own[k]
        body.anchor_norm = body.norm
        body.anchor_travel += away
        body.anchor_motion += moved
        away = moved = 0.0
    body.energy_travel, body.motion_travel = body.anchor_travel + away, body.anchor_motion + moved
    body.energy_noted, body.motion_noted = body.anchor_travel - away, body.anchor_motion - moved


@kernel
def _grown(body: Body, norm: float) -> float:
    """Return (1 + beta E)^2, which is one on a straight wall."""
    growth: float = 1.0 + body.growth * norm
    return growth * growth


@kernel
def _replace_residuals(body: Body, nodes: IntArray, residuals: FloatArray) -> float:
    """Forget the last tick's residuals, set this tick's, return the largest change of any node's."""
    residual, loaded, stamp = body.residual, body.loaded, body.load_stamp
    largest, change = 0.0, 0.0
    for k in range(nodes.shape[0]):
        stamp[nodes[k]] = body.tick
    for k in range(body.n_loaded):
        node = loaded[k]
        if stamp[node] != body.tick:
            old = row(residual, node)
            change = max(change, dot(old, old))
            for axis in range(3):
                residual[node, axis] = 0.0
    for k in range(nodes.shape[0]):
        step2, size2 = 0.0, 0.0
        for axis in range(3):
            step2 += (residuals[k, axis] - residual[nodes[k], axis]) ** 2
            size2 += residuals[k, axis] ** 2
            residual[nodes[k], axis] = residuals[k, axis]
        change, largest = max(change, step2), max(largest, size2)
        loaded[k] = nodes[k]
    body.n_loaded = nodes.shape[0]
    body.largest_residual = math.sqrt(largest)
    return math.sqrt(change)
