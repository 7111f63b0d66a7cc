"""Ways through a branching tube, from its mouth to each end, as polylines: where a point is on them. Plain numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


class TubePaths:
    """Polylines (m, 3) that begin at the mouth together; where two part, their points differ from there on.

    Attributes:
        path_m: dict of str to (m, 3) float64. By the name of the end.
        arc_m: dict of str to (m,) float64. Length of the way to each point.
    """

    def __init__(self, path_m: Mapping[str, Values]) -> None:
        self.path_m = dict(path_m)
        steps = {name: np.linalg.norm(np.diff(path, axis=0), axis=1) for name, path in self.path_m.items()}
        self.arc_m = {name: np.concatenate([[0.0], np.cumsum(each)]) for name, each in steps.items()}

    def progress_m(self, point_m: Values, name: str) -> float:
        """Return how far along the way to ``name`` a point (3,) has come; on another branch that is where they part."""
        nearest, at_m = self.place(point_m)
        return min(at_m, self.shared_m(nearest, name))

    def place(self, point_m: Values) -> tuple[str, float]:
        """Return the way that is nearest to a point (3,), one of them where several are, and how far along it."""
        best: tuple[float, str, float] = (np.inf, "", 0.0)
        for name, path in self.path_m.items():
            start, step = path[:-1], np.diff(path, axis=0)
            share = np.einsum("ij,ij->i", point_m - start, step) / np.maximum(np.einsum("ij,ij->i", step, step), 1e-30)
            away = start + np.clip(share, 0.0, 1.0)[:, None] * step - point_m
            squared = np.einsum("ij,ij->i", away, away)
            k = int(squared.argmin())
            if squared[k] < best[0]:
                arc = self.arc_m[name]
                best = float(squared[k]), name, float(arc[k] + np.clip(share[k], 0.0, 1.0) * (arc[k + 1] - arc[k]))
        return best[1], best[2]

    def beyond(self, point_m: Values) -> list[str]:
        """Return the ends that can still be reached from a point (3,) without drawing back."""
        nearest, at_m = self.place(point_m)
        return [name for name in self.path_m if self.shared_m(nearest, name) >= at_m]

    def shared_m(self, one: str, other: str) -> float:
        """Return how long two ways are one."""
        if one == other:
            return float(self.arc_m[one][-1])
        n = min(len(self.path_m[one]), len(self.path_m[other]))
        differs = np.any(self.path_m[one][:n] != self.path_m[other][:n], axis=1)
        return float(self.arc_m[one][max(int(np.argmax(differs)) - 1, 0) if differs.any() else n - 1])
