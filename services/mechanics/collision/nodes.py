"""Where the nodes of a deforming wall are in this tick: none is placed before it is needed, and none twice."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.shell import Body, Patch, Shell, shell_at
from services.mechanics.collision.turned import turn_into_place
from services.mechanics.compiled import kernel, summing_kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import Vector, put_row, row


@kernel
def node_position(body: Body, node: int) -> Vector:
    """Return the deformed position of a node, computing it at most once a tick."""
    if body.stamp[node] != body.tick:
        _place_anew(body, node)
    return row(body.position, node)


@kernel
def _place_anew(body: Body, node: int) -> None:
    """Place a node; apart from `node_position`, which is short enough to be inlined wherever a corner is read."""
    body.stamp[node] = body.tick
    body.nodes_placed += 1
    if body.centre.shape[0] == 0:
        _place(body, node, body.rest)
    else:
        _place(body, node, body.arm)
        turn_into_place(body, node)


@summing_kernel
def _place(body: Body, node: int, rest: FloatArray) -> None:
    """Evaluate rest + Phi q + residual."""
    q, Phi = body.q, body.Phi
    for axis in range(3):
        modal = 0.0
        for k in range(q.shape[0]):
            modal += Phi[node, axis, k] * q[k]
        body.position[node, axis] = rest[node, axis] + modal + body.residual[node, axis]


@kernel
def corner_positions(body: Body, patch: Patch, triangle: int) -> tuple[Vector, Vector, Vector]:
    """Return the deformed corners of a triangle."""
    corner = patch.triangles
    return (
        node_position(body, corner[triangle, 0]),
        node_position(body, corner[triangle, 1]),
        node_position(body, corner[triangle, 2]),
    )


@kernel
def place_nodes(address: Address[Shell], nodes: IntArray, out: FloatArray) -> None:
    """Write the deformed positions of ``nodes`` (k,) into ``out`` (k, 3)."""
    body = shell_at(address).body
    for k in range(nodes.shape[0]):
        put_row(out, k, node_position(body, nodes[k]))
