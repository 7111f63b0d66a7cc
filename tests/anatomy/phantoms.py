"""Ducts whose surface is known, and volumes made of them as a scanner and a segmentation would."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.surface.branched_tubes import Tube, branch_of, union_distance_m


def tube(
    name: str, length_mm: float, radius_mm: float, curvature_1_m: float = 0.0, end_mm: float | None = None
) -> Tube:
    end = radius_mm if end_mm is None else end_mm
    return Tube(name, np.zeros(3), np.eye(3), 1e-3 * length_mm, 1e-3 * radius_mm, 1e-3 * end, curvature_1_m, "held")


def branch(parent: Tube, at_mm: float, angle: float, azimuth: float, made: Tube) -> Tube:
    origin_m, axes = branch_of(parent, 1e-3 * at_mm, angle, azimuth)
    radii = made.radius_m, made.end_radius_m
    return Tube(made.name, origin_m, axes, made.length_m, *radii, made.curvature_1_m, "held")


def on(before: Tube, made: Tube, azimuth: float = 0.0) -> Tube:
    """Return a tube that goes on where another ends, bending to the side `azimuth`."""
    origin_m, axes = branch_of(before, before.length_m, 0.0, azimuth)
    return Tube(made.name, origin_m, axes, made.length_m, made.radius_m, made.end_radius_m, made.curvature_1_m, "held")


def straight() -> list[Tube]:
    return [tube("a", 40.0, 3.0, end_mm=2.4)]


def curved() -> list[Tube]:
    return [tube("a", 45.0, 2.5, 35.0)]


def s_shaped() -> list[Tube]:
    first = tube("a", 25.0, 2.2, 45.0)
    return [first, on(first, tube("b", 25.0, 2.2, -45.0))]


def forked() -> list[Tube]:
    """Return a common duct that a cystic duct leaves."""
    common = tube("common", 50.0, 3.5, 8.0, 3.2)
    return [common, branch(common, 22.0, 0.9, 0.7, tube("cystic", 32.0, 2.2, 20.0, 2.0))]


@dataclass
class Scan:
    """A label of known tubes on a grid; lengths in mm.

    Attributes:
        labels: (ni, nj, nk) uint8.
        origin_mm, spacing_mm, directions: Of the grid; axes of i, j, k as columns, LPS.
    """

    tubes: list[Tube]
    labels: np.ndarray
    origin_mm: np.ndarray
    spacing_mm: np.ndarray
    directions: np.ndarray

    def surface_error_mm(self, points_m: np.ndarray) -> np.ndarray:
        return 1e3 * np.abs(union_distance_m(self.tubes, points_m))

    def axis_m(self) -> np.ndarray:
        """Return points of the tubes' axes, which go on in the balls at their ends."""
        axes = []
        for t in self.tubes:
            axes += [t.place(at)[0] for at in np.linspace(0.0, t.length_m, 800)]
            for at, way in ((0.0, -t.radius_m), (t.length_m, t.end_radius_m)):
                end_m, (along, _, _) = t.place(at)
                axes += [end_m + share * way * along for share in np.linspace(0.0, 1.0, 60)]
        return np.array(axes)

    def axis_error_mm(self, points_m: np.ndarray) -> np.ndarray:
        return 1e3 * scipy.spatial.KDTree(self.axis_m()).query(points_m)[0]


def turned(a: float, b: float, c: float) -> np.ndarray:
    return scipy.spatial.transform.Rotation.from_euler("xyz", [a, b, c]).as_matrix()


OBLIQUE = turned(0.3, -0.5, 0.2)


def scan(
    tubes: list[Tube],
    spacing_mm: tuple[float, float, float] = (0.5, 0.5, 0.5),
    directions: np.ndarray = OBLIQUE,
    noise_mm: float = 0.0,
    thickness_mm: float = 0.0,
    size: int | None = None,
    seed: int = 0,
    margin_mm: float = 3.0,
) -> Scan:
    """Return the label 1 of all inside the tubes, and 2 of a wall round them; the boundary is noisy by `noise_mm`."""
    spacing = 1e-3 * np.array(spacing_mm)
    reach = max(max(t.radius_m, t.end_radius_m) for t in tubes) + 1e-3 * (thickness_mm + margin_mm)
    axis = np.concatenate([[t.place(at)[0] for at in np.linspace(0.0, t.length_m, 60)] for t in tubes])
    along = axis @ directions
    low = along.min(axis=0) - reach
    n = np.ceil((along.max(axis=0) + reach - low) / spacing).astype(int) + 1
    grid = np.stack(np.meshgrid(*(np.arange(k) for k in n), indexing="ij"), axis=-1).reshape(-1, 3)
    places = (low + grid * spacing) @ directions.T
    near = scipy.spatial.KDTree(axis).query(places, distance_upper_bound=reach)[0] < np.inf
    distance = np.full(len(places), math.inf)
    distance[near] = union_distance_m(tubes, places[near])
    distance += np.random.default_rng(seed).normal(0.0, 1e-3 * noise_mm, len(places)) if noise_mm else 0.0
    labels = np.where(distance < 0.0, 1, np.where(distance < 1e-3 * thickness_mm, 2, 0)).reshape(n).astype(np.uint8)
    if size is not None:
        before = [(size - k) // 2 for k in n]
        labels = np.pad(labels, [(b, size - k - b) for b, k in zip(before, n, strict=True)])
        low = low - np.array(before) * spacing
    return Scan(tubes, labels, 1e3 * directions @ low, np.array(spacing_mm), directions)
