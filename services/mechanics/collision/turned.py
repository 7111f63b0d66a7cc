"""Nodes of a wall whose cross-sections turn (`reduction.warping`), placed one by one in the kernels of detection."""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.collision.primitives import put, vector
from services.mechanics.compiled import Struct, floats, ints, kernel
from services.mechanics.compiled.vectors import Vector, along, cross, dot, scaled, squared_distance
from services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp


def turned_arrays(warp: TubeWarp, frame: SectionFrame) -> dict[str, np.ndarray]:
    """Where the parts of a warped position lie; turns and centres are those that ``frame`` updates."""
    return {
        "Phi": warp.local,
        "arm": warp.arm_m,
        "segment": warp.sections.segment,
        "fraction": warp.sections.fraction,
        "turn": frame.turns,
        "centre": frame.centres_m,
        "last_turn": frame.turns.copy(),
        "last_centre": frame.centres_m.copy(),
        "rest_centre": warp.sections.centres_m,
    }


@kernel
def note_turns(body: Struct) -> None:
    """Add to the travel how far the sections have carried any node in this tick: shift plus turn times arm.

    A node that its section carries along also has what the modes and the residual have displaced it there.
    """
    arm = body.largest_arm + body.largest_reach * body.norm + body.largest_residual
    shift, turn, carried = 0.0, 0.0, 0.0
    for k in range(body.n_stations):
        centre, w = vector(floats(body.centre), k), vector(floats(body.turn), k)
        from_rest = math.sqrt(squared_distance(centre, vector(floats(body.rest_centre), k)))
        carried = max(carried, from_rest + math.sqrt(dot(w, w)) * arm)
        shift = max(shift, squared_distance(centre, vector(floats(body.last_centre), k)))
        turn = max(turn, squared_distance(w, vector(floats(body.last_turn), k)))
        put(floats(body.last_centre), k, centre)
        put(floats(body.last_turn), k, w)
    body.turned_shift = carried
    body.turned_travel += math.sqrt(shift) + math.sqrt(turn) * arm
    body.travel += body.turned_travel
    body.travel_noted += body.turned_travel


@kernel
def turn_into_place(body: Struct, node: int) -> None:
    """Turn a node's place in its section by the section's rotation, and put it at the axis: Rodrigues' formula."""
    k, t = ints(body.segment)[node], floats(body.fraction)[node]
    w = _between(body.turn, k, t)
    angle2 = dot(w, w)
    if angle2 < 1e-8:  # the series are exact to rounding there
        first, second = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    place = vector(floats(body.position), node)
    once = cross(w, place)
    turned = along(along(place, once, first), cross(w, once), second)
    put(floats(body.position), node, along(_between(body.centre, k, t), turned, 1.0))


@kernel
def _between(stations: int, k: int, t: float) -> Vector:
    return along(scaled(vector(floats(stations), k), 1.0 - t), vector(floats(stations), k + 1), t)
