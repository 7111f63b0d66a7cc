"""Data for drawing: the layout, which changes only with the scene, and the picture, which changes every frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, IntArray
from trocar.services.mechanics.scene.instruments import DrawnPart
from trocar.services.mechanics.scene.wall_bar import WallBar


@dataclass(frozen=True, slots=True)
class ToolShape:
    """Constant shape of one tool, SI units: its round parts in its own frame, and jaws if it has any."""

    name: str
    port_m: tuple[float, float, float]
    shaft_radius_m: float
    parts: tuple[DrawnPart, ...]
    jaw_length_m: float = 0.0
    jaw_radius_m: float = 0.0

    @property
    def has_jaws(self) -> bool:
        """Whether there are jaws to draw."""
        return self.jaw_length_m > 0.0


@dataclass(frozen=True, slots=True)
class PictureLayout:
    """Data for a renderer before the first picture.

    Attributes:
        epoch: int. Goes up with every change; a picture belongs to one epoch.
        rest_m: (n, 3) float32. Undeformed mid-surface of the duct, to which the tissue's grain is attached; empty until
            the duct is known.
        triangles: (t, 3) int32. Counter-clockwise seen from outside.
        thickness_m: float. Thickness of the wall, half on each side of the mid-surface.
        mouth, clamped: tuple of int. Nodes of the free and the held rim, empty if unnamed.
        neck: bool. Whether the mouth is the neck of the gallbladder, and the catheter comes in elsewhere.
        bars: tuple of WallBar. What lies on the wall and follows it: the legs of a clip.
        stone_radii_m: tuple of float. Radius of each stone in the duct.
        n_particles: int. Number of particles of the catheter and of the protruding guide wire, the last segments.
    """

    epoch: int
    scene: str
    rest_m: Float32Array
    triangles: IntArray
    thickness_m: float
    mouth: tuple[int, ...]
    clamped: tuple[int, ...]
    n_particles: int
    catheter_radius_m: float
    tools: tuple[ToolShape, ...]
    n_wire_segments: int = 0
    wire_radius_m: float = 0.0
    bars: tuple[WallBar, ...] = ()
    stone_radii_m: tuple[float, ...] = ()
    neck: bool = False

    def rods(self) -> list[tuple[slice, float]]:
        """Return the ranges of particles of the catheter and of its wire, if any, with their radii."""
        tip = max(self.n_particles - 1 - self.n_wire_segments, 0)
        wire = [(slice(tip, None), self.wire_radius_m)] if self.n_wire_segments else []
        return [(slice(tip + 1), self.catheter_radius_m), *wire]


@dataclass(slots=True)
class Picture:
    """One picture, world frame, SI units.

    Attributes:
        points_m: (n, 3) float32. Mid-surface of the duct.
        centreline_m: (m, 3) float32. Catheter particles, tip last.
        poses: (k, 7) float32. Junction J and quaternion wxyz of each tool: x along the shaft from the port, y the way
            jaw A opens.
        jaw_rad: (k,) float32. Opening between both jaws.
        force_n: (k, 3) float32. Force of the tissue on each tool.
        stones_m: (s, 3) float32. Middle of each stone of the layout.
    """

    epoch: int
    sequence: int = 0
    tick: int = 0
    origin_ns: int = 0
    points_m: Float32Array = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    centreline_m: Float32Array = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    poses: Float32Array = field(default_factory=lambda: np.zeros((0, 7), np.float32))
    jaw_rad: Float32Array = field(default_factory=lambda: np.zeros(0, np.float32))
    force_n: Float32Array = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    inserted_length_m: float = 0.0
    stones_m: Float32Array = field(default_factory=lambda: np.zeros((0, 3), np.float32))
