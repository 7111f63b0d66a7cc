"""Tocher's bending triangle, the paper's: a deflection of nine polynomial terms.

w = a1 + a2 x + a3 y + a4 x² + a5 xy + a6 y² + a7 x³ + a8 (x²y + xy²) + a9 y³, y along edge 12 and x towards node 3
(Rao, The Finite Element Method in Engineering; Basdogan et al. 2001, appendix A; the element is Tocher's). Kept
for comparison only: merging x²y with xy² makes it depend on which node is first, it has no complete constant-twist
state under rotation of its axes, and it fails the patch test. With nodes (0, 0), (0, a), (b, c) the polynomial's
coefficients follow from the nodal values only where a - b - 2 c is not zero: right isosceles triangles with legs
on the axes, which structured meshes are full of, are singular. There the nodes are renamed cyclically.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.triangle import signed_areas

SINGULAR_RATIO = 0.05
"""|a - b - 2c| / (a + b + 2|c|) below which another node is taken as first."""

# Degree-3 rule on area coordinates, exact for the quadratic energy density.
MIDSIDE_POINTS = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])


def stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 9, 9) bending stiffness; see `element.StiffnessKernel`.

    Raises ValueError if a triangle is singular whichever node comes first.
    """
    rigidity = thickness[:, None, None] ** 3 / 12.0 * D
    first = _first_node(xy)
    K = np.empty((len(xy), 9, 9))
    for shift in range(3):
        chosen = np.flatnonzero(first == shift)
        order = (np.arange(3) + shift) % 3
        dofs = (3 * order[:, None] + np.arange(3)).ravel()
        part = _stiffness_in_order(xy[chosen][:, order], rigidity[chosen])
        K[np.ix_(chosen, dofs, dofs)] = part
    return K


def singularity(xy: FloatArray) -> FloatArray:
    """(m, 3) measure |a - b - 2c| / (a + b + 2|c|) with each node as the first; zero is singular."""
    measures = []
    for shift in range(3):
        a, b, c = _edge_lengths(np.roll(xy, -shift, axis=1))
        measures.append(np.abs(a - b - 2.0 * c) / (a + b + 2.0 * np.abs(c)))
    return np.stack(measures, axis=1)


def _first_node(xy: FloatArray) -> FloatArray:
    """(m,) node to start from: the given one unless it makes the element singular, then the best."""
    measure = singularity(xy)
    first = np.where(measure[:, 0] >= SINGULAR_RATIO, 0, np.argmax(measure, axis=1))
    hopeless = measure[np.arange(len(xy)), first] < SINGULAR_RATIO
    if hopeless.any():
        raise ValueError(
            f"element 'tocher' is singular on triangle {int(np.flatnonzero(hopeless)[0])} whichever node is first; "
            "use 'dkt' or move its nodes"
        )
    return first


def _edge_lengths(xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """a, b, c of nodes (0, 0), (0, a), (b, c) in the element's own axes."""
    edge, third = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    a = np.linalg.norm(edge, axis=1)
    b = 2.0 * signed_areas(xy) / a
    c = np.sum(edge * third, axis=1) / a
    return a, b, c


def _stiffness_in_order(xy: FloatArray, rigidity: FloatArray) -> FloatArray:
    """Stiffness with nodes as ordered, through the element's own left-handed axes (x towards node 3)."""
    y_axis = (xy[:, 1] - xy[:, 0]) / np.linalg.norm(xy[:, 1] - xy[:, 0], axis=1, keepdims=True)
    x_axis = np.stack([-y_axis[:, 1], y_axis[:, 0]], axis=1)
    axes = np.stack([x_axis, y_axis], axis=1)
    own = (xy - xy[:, :1]) @ axes.transpose(0, 2, 1)
    to_slopes = _own_slopes(axes)
    A = _nodal_values(own)
    D = _turn_rigidity(rigidity, axes)
    energy = np.zeros((len(xy), 9, 9))
    weight = signed_areas(xy)[:, None, None] / 3.0
    for point in MIDSIDE_POINTS:
        B = _curvatures(point @ own)
        energy += weight * (B.transpose(0, 2, 1) @ D @ B)
    from_nodes = np.linalg.solve(A, to_slopes)
    return from_nodes.transpose(0, 2, 1) @ energy @ from_nodes


def _own_slopes(axes: FloatArray) -> FloatArray:
    """(m, 9, 9) (w, w,x', w,y') per node in own axes from (w, theta_x, theta_y) in local axes."""
    rotation_to_gradient = np.array([[0.0, -1.0], [1.0, 0.0]])
    T = np.zeros((len(axes), 9, 9))
    for node in range(3):
        T[:, 3 * node, 3 * node] = 1.0
        rows = slice(3 * node + 1, 3 * node + 3)
        T[:, rows, rows] = axes @ rotation_to_gradient
    return T


def _nodal_values(own: FloatArray) -> FloatArray:
    """(m, 9, 9) (w, w,x, w,y) of each node from the polynomial's nine coefficients."""
    x, y = own[..., 0], own[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    w = [one, x, y, x**2, x * y, y**2, x**3, x**2 * y + x * y**2, y**3]
    w_x = [zero, one, zero, 2 * x, y, zero, 3 * x**2, 2 * x * y + y**2, zero]
    w_y = [zero, zero, one, zero, x, 2 * y, zero, x**2 + 2 * x * y, 3 * y**2]
    rows = np.stack([np.stack(row, axis=-1) for row in (w, w_x, w_y)], axis=2)
    return rows.reshape(len(own), 9, 9)


def _curvatures(point: FloatArray) -> FloatArray:
    """(m, 3, 9) (-w,xx, -w,yy, -2 w,xy) at one point from the polynomial's coefficients."""
    x, y = point.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    xx = [zero, zero, zero, 2 * one, zero, zero, 6 * x, 2 * y, zero]
    yy = [zero, zero, zero, zero, zero, 2 * one, zero, 2 * x, 6 * y]
    xy = [zero, zero, zero, zero, 2 * one, zero, zero, 4 * (x + y), zero]
    return -np.stack([np.stack(row, axis=-1) for row in (xx, yy, xy)], axis=1)


def _turn_rigidity(rigidity: FloatArray, axes: FloatArray) -> FloatArray:
    """(m, 3, 3) rigidity in the element's own axes (a turn and a reflection of the local ones)."""
    (l1, m1), (l2, m2) = axes[:, 0].T, axes[:, 1].T
    T = np.stack(
        [
            np.stack([l1 * l1, l2 * l2, l1 * l2], axis=1),
            np.stack([m1 * m1, m2 * m2, m1 * m2], axis=1),
            np.stack([2 * l1 * m1, 2 * l2 * m2, l1 * m2 + l2 * m1], axis=1),
        ],
        axis=1,
    )
    turned: FloatArray = T.transpose(0, 2, 1) @ rigidity @ T
    return turned
