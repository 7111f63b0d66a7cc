"""The start of a tick of a deforming surface: its state taken over, and what the search tree is told of the motion."""

from __future__ import annotations

import math

from services.mechanics.collision.primitives import dot, vector
from services.mechanics.kernel import Struct, floats, ints, kernel, longs
from services.mechanics.mesh import FloatArray, IntArray


@kernel
def take_state(body: Struct, q: FloatArray, nodes: IntArray, residuals: FloatArray) -> bool:
    """Take over q and the residuals if they are sound; add this tick's largest possible node motion to the travel."""
    omega, old = floats(body.omega), floats(body.q)
    norm, change, nothing = 0.0, 0.0, 0.0
    for k in range(body.n_modes):
        norm += (omega[k] * q[k]) ** 2
        change += (omega[k] * (q[k] - old[k])) ** 2
    for k in range(residuals.shape[0]):
        nothing += (residuals[k, 0] + residuals[k, 1] + residuals[k, 2]) * 0.0
        if nodes[k] < 0 or nodes[k] >= body.n_nodes:
            return False
    if not math.isfinite(norm + change + nothing):
        return False
    for k in range(body.n_modes):
        old[k] = q[k]
    body.tick += 1
    before, body.norm, change = body.norm, math.sqrt(norm), math.sqrt(change)
    body.energy_norm = body.norm * _grown(body, body.norm)
    body.energy_travel += change * _grown(body, max(before, body.norm))
    body.residual_travel += _replace_residuals(body, nodes, residuals)
    body.travel = body.largest_reach * body.energy_travel + body.residual_travel
    return True


@kernel
def _grown(body: Struct, norm: float) -> float:
    """Return (1 + beta E)^2, which is one on a straight wall."""
    growth: float = 1.0 + body.growth * norm
    return growth * growth


@kernel
def _replace_residuals(body: Struct, nodes: IntArray, residuals: FloatArray) -> float:
    """Forget the last tick's residuals, set this tick's, return the largest change of any node's."""
    residual, loaded, stamp = floats(body.residual), ints(body.loaded), longs(body.load_stamp)
    largest, change = 0.0, 0.0
    for k in range(nodes.shape[0]):
        stamp[nodes[k]] = body.tick
    for k in range(body.n_loaded):
        node = loaded[k]
        if stamp[node] != body.tick:
            old = vector(residual, node)
            change = max(change, dot(old, old))
            for axis in range(3):
                residual[3 * node + axis] = 0.0
    for k in range(nodes.shape[0]):
        step2, size2 = 0.0, 0.0
        for axis in range(3):
            step2 += (residuals[k, axis] - residual[3 * nodes[k] + axis]) ** 2
            size2 += residuals[k, axis] ** 2
            residual[3 * nodes[k] + axis] = residuals[k, axis]
        change, largest = max(change, step2), max(largest, size2)
        loaded[k] = nodes[k]
    body.n_loaded = nodes.shape[0]
    body.largest_residual = math.sqrt(largest)
    return math.sqrt(change)
