"""Parametric panels: a plate, an annulus, a piece of a cylinder or of a sphere, as a grid of triangles.

A full turn leaves a slit: its two edges lie in one place and are not joined.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import MOST_TRIANGLES

FULL_TURN_RAD = 2.0 * math.pi * (1.0 + 1e-6)
"""An angle written to seven digits may be a little more than a turn."""


@dataclass(frozen=True)
class Plate:
    """A rectangle in the plane z = 0, from the origin along x (``length_m``) and y (``width_m``)."""

    length_m: float
    width_m: float
    n_along: int
    n_across: int

    def mesh(self) -> TriangleMesh:
        """Edges ``start`` and ``end`` along x, ``bottom`` and ``top`` along y; normals along +z."""
        _positive("plate", length_m=self.length_m, width_m=self.width_m)
        cells = _cells("plate", n_along=self.n_along, n_across=self.n_across)
        return _panel(lambda u, v: (self.length_m * u, self.width_m * v, 0.0 * u), cells, ("bottom", "top"))


@dataclass(frozen=True)
class Annulus:
    """A flat ring round the z axis, from the x axis through ``angle_rad``."""

    inner_radius_m: float
    outer_radius_m: float
    n_around: int
    n_across: int
    angle_rad: float = 2.0 * math.pi

    def mesh(self) -> TriangleMesh:
        """Edges ``start`` and ``end`` of the turn, ``inner`` and ``outer``."""
        _positive("annulus", inner_radius_m=self.inner_radius_m)
        if not self.inner_radius_m < self.outer_radius_m < math.inf:
            raise ValueError(f"annulus: outer_radius_m must be above inner_radius_m, is {self.outer_radius_m}")
        _turn("annulus", self.angle_rad)

        def place(u: FloatArray, v: FloatArray) -> tuple[FloatArray, ...]:
            radius, angle = self.inner_radius_m + (self.outer_radius_m - self.inner_radius_m) * v, self.angle_rad * u
            return radius * np.cos(angle), radius * np.sin(angle), 0.0 * u

        return _panel(place, _cells("annulus", n_around=self.n_around, n_across=self.n_across), ("inner", "outer"))


@dataclass(frozen=True)
class Cylinder:
    """A piece of a cylinder round the z axis, from the x axis through ``angle_rad``, and from z = 0 up."""

    radius_m: float
    length_m: float
    n_around: int
    n_along: int
    angle_rad: float = 2.0 * math.pi

    def mesh(self) -> TriangleMesh:
        """Edges ``start`` and ``end`` of the turn, ``bottom`` and ``top``; normals away from the axis."""
        _positive("cylinder", radius_m=self.radius_m, length_m=self.length_m)
        _turn("cylinder", self.angle_rad)

        def place(u: FloatArray, v: FloatArray) -> tuple[FloatArray, ...]:
            angle = self.angle_rad * u
            return self.radius_m * np.cos(angle), self.radius_m * np.sin(angle), self.length_m * v

        return _panel(place, _cells("cylinder", n_around=self.n_around, n_along=self.n_along), ("bottom", "top"))


@dataclass(frozen=True)
class Sphere:
    """A piece of a sphere round the origin, from the x axis through ``angle_rad``, between two latitudes."""

    radius_m: float
    n_around: int
    n_up: int
    angle_rad: float = 2.0 * math.pi
    latitudes_rad: tuple[float, float] = (0.0, math.radians(72.0))

    def mesh(self) -> TriangleMesh:
        """Edges ``start`` and ``end`` of the turn, ``bottom`` and ``top``; normals away from the origin."""
        _positive("sphere", radius_m=self.radius_m)
        _turn("sphere", self.angle_rad)
        low, high = self.latitudes_rad
        if not -0.5 * math.pi < low < high < 0.5 * math.pi:
            raise ValueError(f"sphere: latitudes_rad must rise, between the poles -pi/2 and pi/2, are {low} and {high}")

        def place(u: FloatArray, v: FloatArray) -> tuple[FloatArray, ...]:
            around, up = self.angle_rad * u, low + (high - low) * v
            ring = self.radius_m * np.cos(up)
            return ring * np.cos(around), ring * np.sin(around), self.radius_m * np.sin(up)

        return _panel(place, _cells("sphere", n_around=self.n_around, n_up=self.n_up), ("bottom", "top"))


def _panel(
    place: Callable[[FloatArray, FloatArray], tuple[FloatArray, ...]], cells: tuple[int, int], sides: tuple[str, str]
) -> TriangleMesh:
    """Map the unit square, diagonals in turn; edges and corners are vertex sets."""
    n_u, n_v = cells
    u, v = np.meshgrid(np.linspace(0.0, 1.0, n_u + 1), np.linspace(0.0, 1.0, n_v + 1), indexing="ij")
    vertices = np.stack([axis.ravel() for axis in place(u, v)], axis=1)
    index = np.arange(u.size, dtype=np.int32).reshape(u.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    turned = (np.add.outer(np.arange(n_u), np.arange(n_v)) % 2 == 1)[..., None]
    first = np.where(turned, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
    second = np.where(turned, np.stack([b, c, d], -1), np.stack([a, c, d], -1))
    low, high = sides
    ends = {"start": index[0], "end": index[-1]}
    sets = {**ends, low: index[:, 0], high: index[:, -1]}
    for name, edge in ends.items():
        sets |= {f"{name}_{low}": edge[:1], f"{name}_{high}": edge[-1:]}
    return TriangleMesh(vertices, np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]), sets)


def _positive(shape: str, **sizes_m: float) -> None:
    for name, size_m in sizes_m.items():
        if not (math.isfinite(size_m) and size_m > 0.0):
            raise ValueError(f"{shape}: {name} must be positive, is {size_m}")


def _turn(shape: str, angle_rad: float) -> None:
    if not 0.0 < angle_rad <= FULL_TURN_RAD:
        raise ValueError(f"{shape}: angle_rad must be above 0 and at most a full turn, is {angle_rad}")


def _cells(shape: str, **counts: int) -> tuple[int, int]:
    for name, count in counts.items():
        if count < 1:
            raise ValueError(f"{shape}: {name} must be at least 1, is {count}")
    first, second = counts.values()
    if 2 * first * second > MOST_TRIANGLES:
        raise ValueError(
            f"{shape}: {' times '.join(counts)} make {2.0 * first * second:.2g} triangles, at most "
            f"{MOST_TRIANGLES:.2g} can be solved"
        )
    return first, second
