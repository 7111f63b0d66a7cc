"""Nodes of a wall whose cross-sections turn (`reduction.warping`), placed one by one in the kernels of detection."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.shell import Body
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, along, cross, dot, put_row, row, scaled, squared_distance


@kernel
def note_turns(body: Body) -> None:
    """Add to the travel how far the sections have carried any node in this tick: shift plus turn times arm.

    A node that its section carries along also has what the modes and the residual have displaced it there.
    """
    arm = body.largest_arm + body.largest_reach * body.norm + body.largest_residual
    shift, turn, carried = 0.0, 0.0, 0.0
    for k in range(body.centre.shape[0]):
        centre, w = row(body.centre, k), row(body.turn, k)
        from_rest = math.sqrt(squared_distance(centre, row(body.rest_centre, k)))
        carried = max(carried, from_rest + math.sqrt(dot(w, w)) * arm)
        shift = max(shift, squared_distance(centre, row(body.last_centre, k)))
        turn = max(turn, squared_distance(w, row(body.last_turn, k)))
        put_row(body.last_centre, k, centre)
        put_row(body.last_turn, k, w)
    body.turned_shift = carried
    body.turned_travel += math.sqrt(shift) + math.sqrt(turn) * arm
    body.travel += body.turned_travel
    body.travel_noted += body.turned_travel


@kernel
def turn_into_place(body: Body, node: int) -> None:
    """Turn a node's place in its section by the section's rotation, and put it at the axis: Rodrigues' formula."""
    k, t = body.segment[node], body.fraction[node]
    w = _between(body.turn, k, t)
    angle2 = dot(w, w)
    if angle2 < 1e-8:  # the series are exact to rounding there
        first, second = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    place = row(body.position, node)
    once = cross(w, place)
    turned = along(along(place, once, first), cross(w, once), second)
    put_row(body.position, node, along(_between(body.centre, k, t), turned, 1.0))


@kernel
def _between(stations: FloatArray, k: int, t: float) -> Vector:
    return along(scaled(row(stations, k), 1.0 - t), row(stations, k + 1), t)
