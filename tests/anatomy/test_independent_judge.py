"""Surfaces made of drawn ducts, judged by nothing of this project: own ducts, own voxels, own file, own distances.

A duct is a smooth random curve with balls of a varying radius on it. Their envelope is known in closed form, and is
sampled; voxels are inside where their middle is in a ball, moved by noise. Distances are those between samples, by
SciPy's search: from the surface that was made to the known one, and from the known one to the made.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from trocar.services.anatomy.making import AnatomyRequest, make_anatomy

pytest.importorskip("SimpleITK", reason="the scan extra is not installed")

SAMPLE_MM = 0.08
"""Distance of samples: by that much over the square root of two at most a distance between samples is too long."""


@dataclass(frozen=True)
class Drawn:
    """A duct of balls: middles (k, 3) in mm, radii (k,) in mm, unit tangents (k, 3), slope of the radius (k,)."""

    middle_mm: np.ndarray
    radius_mm: np.ndarray
    tangent: np.ndarray
    slope: np.ndarray

    def surface_mm(self) -> np.ndarray:
        """Return samples of the envelope, and of the balls' halves at both ends."""
        around = np.linspace(0.0, 2.0 * np.pi, 260, endpoint=False)
        rings = []
        for middle, radius, along, slope in zip(self.middle_mm, self.radius_mm, self.tangent, self.slope, strict=True):
            rings.append(middle + radius * (_circle(along, around) * np.sqrt(1.0 - slope**2) - slope * along))
        for k, sign in ((0, -1.0), (-1, 1.0)):
            least = -sign * self.slope[k]
            for height in np.linspace(least, 1.0, 60):
                across = np.sqrt(1.0 - height**2)
                ring = across * _circle(self.tangent[k], around) + sign * height * self.tangent[k]
                rings.append(self.middle_mm[k] + self.radius_mm[k] * ring)
        return np.concatenate(rings)


def _circle(along: np.ndarray, around: np.ndarray) -> np.ndarray:
    one = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    one /= np.linalg.norm(one)
    return np.cos(around)[:, None] * one + np.sin(around)[:, None] * np.cross(along, one)


def draw(seed: int) -> Drawn:
    """Return a duct of some 50 mm, bent twice, 3 to 6 mm wide."""
    random = np.random.default_rng(seed)
    knots = np.cumsum(np.array([[0.0, 0.0, 0.0], *(random.normal([13.0, 0.0, 0.0], [1.0, 4.0, 4.0], (4, 3)))]), axis=0)
    course = CubicSpline(np.arange(5.0), knots)
    width = CubicSpline(np.arange(5.0), random.uniform(1.5, 3.0, 5), bc_type="natural")
    at = np.linspace(0.0, 4.0, 900)
    speed = course(at, 1)
    pace = np.linalg.norm(speed, axis=1)
    return Drawn(course(at), width(at), speed / pace[:, None], width(at, 1) / pace)


def write_scan(duct: Drawn, path: Path, spacing_mm: np.ndarray, noise_mm: float, seed: int) -> None:
    """Write the voxels whose middles lie in the duct as NRRD, with oblique axes."""
    axes = Rotation.from_euler("xyz", [0.2, -0.4, 0.3]).as_matrix()
    middle = duct.middle_mm @ axes  # along the axes of the grid
    low = (middle - duct.radius_mm[:, None]).min(axis=0) - 4.0
    n = np.ceil(((middle + duct.radius_mm[:, None]).max(axis=0) + 4.0 - low) / spacing_mm).astype(int)
    depth = np.full(n, np.inf)
    for centre, radius in zip(middle, duct.radius_mm, strict=True):
        first = np.maximum(np.floor((centre - radius - 2.0 - low) / spacing_mm).astype(int), 0)
        last = np.minimum(np.ceil((centre + radius + 2.0 - low) / spacing_mm).astype(int) + 1, n)
        box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        sides = [low[k] + spacing_mm[k] * np.arange(first[k], last[k]) - centre[k] for k in range(3)]
        away = np.sqrt(sides[0][:, None, None] ** 2 + sides[1][:, None] ** 2 + sides[2] ** 2)
        np.minimum(depth[box], away - radius, out=depth[box])
    depth += np.random.default_rng(seed).normal(0.0, noise_mm, depth.shape)
    vector = " ".join("(" + ",".join(f"{x:.17g}" for x in spacing_mm[k] * axes[:, k]) + ")" for k in range(3))
    origin = ",".join(f"{x:.17g}" for x in axes @ low)
    head = (
        f"NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {n[0]} {n[1]} {n[2]}\n"
        f"space directions: {vector}\nkinds: domain domain domain\nencoding: raw\nspace origin: ({origin})\n\n"
    )
    path.write_bytes(head.encode() + np.asfortranarray(depth < 0.0).astype(np.uint8).tobytes(order="F"))


def samples_mm(vertices_mm: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return points on the triangles, none further than `SAMPLE_MM` from the next."""
    corners = vertices_mm[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    parts = int(np.ceil(longest / SAMPLE_MM))
    i, j = (grid.ravel() for grid in np.mgrid[0 : parts + 1, 0 : parts + 1])
    weights = np.stack([i, j, parts - i - j], axis=1)[i + j <= parts] / parts
    return np.einsum("wc,tcx->twx", weights, corners).reshape(-1, 3)


CASES = [
    (1, (0.5, 0.5, 0.5), 0.0),
    (2, (0.5, 0.5, 0.5), 0.15),
    (3, (0.4, 0.4, 0.8), 0.1),
    (4, (0.3, 0.6, 0.6), 0.1),
    (5, (0.8, 0.8, 0.8), 0.2),
    (6, (0.5, 0.5, 1.0), 0.15),
]


@pytest.mark.parametrize(("seed", "spacing", "noise_mm"), CASES)
def test_the_surface_of_a_drawn_duct_is_within_half_a_voxel(
    seed: int, spacing: tuple[float, float, float], noise_mm: float, tmp_path: Path
) -> None:
    duct, voxel_mm = draw(seed), float(np.cbrt(np.prod(spacing)))
    write_scan(duct, tmp_path / "duct.nrrd", np.array(spacing), noise_mm, seed)
    mesh = make_anatomy(tmp_path / "duct.nrrd", AnatomyRequest()).surface.mesh
    known_mm, made_mm = duct.surface_mm(), samples_mm(1e3 * mesh.vertices_m, mesh.triangles)
    to_known = KDTree(known_mm).query(made_mm)[0]
    to_made = KDTree(made_mm).query(known_mm[::20])[0]
    for error_mm in (to_known, to_made):
        assert np.percentile(error_mm, 95.0) < 0.5 * voxel_mm, f"{np.percentile(error_mm, 95.0) / voxel_mm:.2f} voxels"
