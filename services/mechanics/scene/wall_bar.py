"""A bar that lies on the wall of a duct and follows a point of it, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class WallBar:
    """A leg of a clip.

    Attributes:
        nodes, weights: Corners of the triangle under its middle, and that point's barycentric weights.
        along, outward: Unit vectors along the bar and out of the duct.
        size_m: Length, width along the duct, and height over the wall.
    """

    nodes: tuple[int, int, int]
    weights: Vector3
    along: Vector3
    outward: Vector3
    size_m: Vector3
