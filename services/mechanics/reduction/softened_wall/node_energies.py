"""Energies that the sites do not resolve, summed node by node; see `remainder`."""

from __future__ import annotations

from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.reduction.softened_wall.softened_wall import N_NODES, NODE, SoftenedWall

LEAST_SHARE = 1e-4
"""Force over the largest one below which a node or a site is left out."""
LINEAR_J, MORE_J = range(2)
"""V of the nodes so far, and what E is larger by than that of the sites."""


@kernel
def begin_nodes(wall: SoftenedWall) -> None:
    """Take the forces on the nodes, if the law of the nodes has a share."""
    largest, count = 0.0, 0
    for node in range(wall.at_nodes.shape[0]):
        largest = max(largest, abs(wall.at_nodes[node]))
    for node in range(wall.at_nodes.shape[0]):
        counts = abs(wall.at_nodes[node]) > LEAST_SHARE * largest
        wall.pressed_nodes[node] = wall.at_nodes[node] if counts else 0.0
        if counts:
            wall.active_nodes[count] = node
            count += 1
    wall.of_nodes[LINEAR_J], wall.of_nodes[MORE_J] = 0.0, 0.0
    wall.made[N_NODES], wall.made[NODE] = count, 0


@summing_kernel
def add_node(wall: SoftenedWall, node: int) -> None:
    """Add a node to both energies."""
    z, n_sites, force = wall.nearby, wall.sites_nearby.shape[1], wall.pressed_nodes[node]
    for k in range(n_sites):
        z[k] = wall.pressed[1, wall.sites_nearby[node, k]]
    for k in range(wall.nodes_nearby.shape[1]):
        z[n_sites + k] = wall.pressed_nodes[wall.nodes_nearby[node, k]]
    cubic = 0.0
    for first in range(z.shape[0]):
        total = 0.0
        if z[first] != 0.0:
            for second in range(z.shape[0]):
                total += wall.sharp[node, first, second] * z[second]
        cubic += z[first] * total
    moved = 0.0
    for k in range(wall.made[N_NODES]):
        other = wall.active_nodes[k]
        moved += wall.node_local[node, other] * wall.pressed_nodes[other]
    wall.of_nodes[LINEAR_J] += 0.5 * force * moved
    wall.of_nodes[MORE_J] += force * cubic / 6.0
