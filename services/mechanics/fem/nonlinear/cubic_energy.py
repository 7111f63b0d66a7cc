"""Cubic part of a shell's strain energy about the undeformed shape: its lowest nonlinear term."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.fem.nonlinear.corotational import CorotationalShell

STEP = 1e-4
"""Of the differences: part of a triangle's size, and angle in rad. Their error is of second order in it."""
CHUNK = 512
"""Triangles whose third derivatives exist at the same time: so many that they take 12 MB, whatever the mesh."""
_AXES = 18
"""Of a triangle: three nodes with six dofs each, as `assembly` numbers them."""


def cubic_tensor_and_energies(
    shell: CorotationalShell, fields: FloatArray, alone: FloatArray
) -> tuple[Float32Array, FloatArray]:
    """Third derivatives (k, k, k) of the strain energy along ``fields``, and the cubic energies (j,) of ``alone``.

    T[a, b, c] = d3E / dx_a dx_b dx_c for the shell moved by sum_a x_a fields_a, rotations being rotation vectors: the
    energy is 1/2 x K x + 1/6 T x x x and terms of fourth order. T is symmetric in its three indices. The triangles'
    third derivatives take most of the time and are computed once for both results.

    Args:
        shell: At rest.
        fields: (6 n, k) displacements and rotations of all nodes.
        alone: (6 n, j) more of them, of which only the energy of each by itself is wanted.
    """
    k = fields.shape[1]
    T, energy = np.zeros((k, k, k), np.float32), np.zeros(alone.shape[1])
    for _, third, local in third_derivatives_and_fields(shell, np.concatenate([fields, alone], axis=1)):
        _add_tensor(T, third, np.ascontiguousarray(local[:, :, :k]))
        energy += _energies(third, local[:, :, k:])
    for a in range(k):
        T[a:, a, a:] = T[a, a:, a:]
        T[a:, a:, a] = T[a, a:, a:]
    return T, energy


def third_derivatives_and_fields(
    shell: CorotationalShell, fields: FloatArray
) -> Iterator[tuple[slice, Float32Array, Float32Array]]:
    """Of some triangles at a time: which, third derivatives (t, 18, 324) in their axes, and fields (t, 18, k) there."""
    for start in range(0, len(shell.triangles), CHUNK):
        part = slice(start, min(start + CHUNK, len(shell.triangles)))
        yield part, _third_derivatives(shell, part), _local_fields(shell, part, fields)


def _add_tensor(T: Float32Array, third: Float32Array, local: Float32Array) -> None:
    """Add what some triangles have in T[a, b, c] for a <= b, c."""
    k = len(T)
    flat = local.reshape(-1, k)
    for a in range(k):
        D = np.einsum("mi,mij->mj", local[:, :, a], third).reshape(-1, _AXES, _AXES)
        T[a, a:, a:] += flat[:, a:].T @ np.matmul(D, local[:, :, a:]).reshape(-1, k - a)


def _energies(third: Float32Array, local: Float32Array) -> FloatArray:
    """(j,) sum over some triangles of third x x x / 6."""
    i, j = np.triu_indices(_AXES)
    times = np.where(i == j, 1.0, 2.0).astype(np.float32)[:, None]
    pairs = third.reshape(-1, _AXES, _AXES, _AXES)[:, i, j] * times
    energy = np.zeros(local.shape[2])
    for D, x in zip(pairs, local, strict=True):
        energy += np.einsum("pk,pk->k", D @ x, x[i] * x[j]) / 6.0
    return energy


def _local_fields(shell: CorotationalShell, part: slice, fields: FloatArray) -> Float32Array:
    """(t, 18, k) fields at the corners of some triangles, in each triangle's axes."""
    k = fields.shape[1]
    corners = fields.reshape(len(fields) // 6, 2, 3, k)[shell.triangles[part]]
    local = np.einsum("mab,mcsbk->mcsak", shell.rest_frames[part], corners)
    return np.ascontiguousarray(local.reshape(len(local), _AXES, k), np.float32)


def _third_derivatives(shell: CorotationalShell, part: slice) -> Float32Array:
    """(t, 18, 324) third derivatives of the energy of some triangles in their own axes."""
    third = np.stack([_tangent_rate(shell, part, axis) for axis in range(_AXES)], axis=1)
    turns = ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2), (0, 1, 3, 2), (0, 2, 1, 3), (0, 3, 2, 1))
    # By spins the tangent is symmetric only where nothing is loaded; the mean is the derivative by rotation vectors.
    mean = np.mean([third.transpose(turn) for turn in turns], axis=0)
    return np.ascontiguousarray(mean.reshape(-1, _AXES, _AXES * _AXES), np.float32)


def _tangent_rate(shell: CorotationalShell, part: slice, axis: int) -> FloatArray:
    """(t, 18, 18) derivative of the tangents of some triangles by one motion of one corner."""
    flat = shell.flat[part]
    size = np.linalg.norm(flat, axis=2).max(axis=1)
    step = STEP * (size if axis % 6 < 3 else np.ones_like(size))
    move = np.zeros((len(flat), _AXES))
    move[:, axis] = step
    change = shell.local_tangents(part, move) - shell.local_tangents(part, -move)
    rate: FloatArray = change / (2.0 * step[:, None, None])
    return rate
