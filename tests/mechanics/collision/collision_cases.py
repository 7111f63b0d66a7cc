"""Independent answers for the tests of collision detection."""

from __future__ import annotations

import numpy as np


def distance_of_hulls(first: np.ndarray, second: np.ndarray) -> float:
    """Distance of two convex hulls given by points (a, 3) and (b, 3), by enumerating active sets.

    The closest points of two simplices lie in the relative interior of a face of each: solve the equality
    problem for every pair of faces and keep the feasible ones.
    """
    best = np.inf
    for face_a in _faces(len(first)):
        for face_b in _faces(len(second)):
            a, b = first[face_a], second[face_b]
            A = np.concatenate([a[1:] - a[0], b[0] - b[1:]]).T
            x = np.linalg.lstsq(A, b[0] - a[0], rcond=None)[0] if A.shape[1] else np.zeros(0)
            u, v = x[: len(a) - 1], x[len(a) - 1 :]
            if min([*u, 1.0 - u.sum(), *v, 1.0 - v.sum()]) >= -1e-12:
                best = min(best, float(np.linalg.norm(a[0] - b[0] + A @ x)))
    return best


def _faces(n: int) -> list[list[int]]:
    return [[k for k in range(n) if mask >> k & 1] for mask in range(1, 2**n)]
