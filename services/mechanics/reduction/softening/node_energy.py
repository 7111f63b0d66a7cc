"""Cubic energy of a force on each single node, to which the energy of forces on the sites is scaled."""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.free_dofs import free_load
from trocar.services.mechanics.reduction.softening.load_sites import evenly_spread
from trocar.services.mechanics.surface.mesh import TriangleMesh

OWN_NODES_MAX = 640
"""Up to which the energy is computed for every node."""
OF_MORE = 320
"""Of a wall of more nodes it is computed for so many, and interpolated."""
NEAREST = 4
"""Nodes between which the energy is interpolated."""
POWER = 1.5
"""Power of a node's own compliance to which its cubic energy is nearly proportional; the quotient is interpolated."""


def known_nodes(mesh: TriangleMesh, own_m_n: FloatArray) -> IntArray:
    """Nodes to compute the energy for; ``own_m_n`` (n,) is what each gives way under a unit force."""
    free = np.flatnonzero(own_m_n > 0.0).astype(np.int32)
    return free if len(free) <= OWN_NODES_MAX else evenly_spread(mesh, free, OF_MORE)


def fields_of(model: ShellModel, nodes: IntArray, directions: FloatArray) -> FloatArray:
    """(6 n, k) displacements and rotations under unit forces along (k, 3), one on each of some nodes."""
    forces = np.zeros((len(nodes), model.mesh.n_vertices, 3))
    forces[np.arange(len(nodes)), nodes] = directions
    fields = np.zeros((model.n_dofs, len(nodes)))
    fields[model.free_dofs] = model.factor.solve(np.stack([free_load(model, each) for each in forces], axis=1))
    return fields


def interpolated_j(mesh: TriangleMesh, own_m_n: FloatArray, known: IntArray, energy_j: FloatArray) -> FloatArray:
    """(n,) energies of all nodes from those of some; zero where a node does not give way."""
    relative = np.zeros(mesh.n_vertices)
    relative[known] = energy_j / own_m_n[known] ** POWER
    others = np.setdiff1d(np.flatnonzero(own_m_n > 0.0), known)
    if len(others):
        distance, near = scipy.spatial.cKDTree(mesh.vertices_m[known]).query(mesh.vertices_m[others], NEAREST)
        weights = 1.0 / np.asarray(distance)
        relative[others] = np.sum(weights * relative[known][near], axis=1) / weights.sum(axis=1)
    own: FloatArray = relative * np.maximum(own_m_n, 0.0) ** POWER
    return own
