"""The cholangiogram: ducts by X-rays while contrast agent flows out of the catheter's tip.

The lumen lies between the inner faces of the wall. Its contrast is that of `contrast_flow`, injected while the tip is
inside; stones and the catheter displace it. Not modelled: the liver's and the gut's resistance (what comes to an open
rim flows out there), bubbles, layers of agent and bile by weight, and that a wall which moves pumps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.protocol.topics import TICK_S
from trocar.review.export.contrast_flow import Channel, ContrastFlow, free_channel
from trocar.review.export.fluoroscopy import Fluoroscope, rod
from trocar.review.export.lumen_cells import LumenCells, fan_m
from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.visualization.picture import Picture, PictureLayout

CONTRAST_1_M = 114.0
"""Attenuation that half-strength agent adds: 150 mg of iodine per ml, 7.58 cm2/g of iodine at 60 keV (NIST XCOM)."""
RATE_M3_S = 0.25e-6
"""Injected per second: a gentle hand, which fills a duct of a millilitre in some seconds; an assumption."""
_LONGEST_S = 0.05
"""Longest step of the flow, in which 12 mm3 come: less than a cell of a lumen that is 5 mm wide."""
_SAMPLE_M = 0.2e-3
"""Distance of the places that stand for a body in the cells: a third of a cell's length."""
EDGE_M = 0.5e-3
"""Longest edge of the lumen's triangles: a cell is then 0.75 mm long, less than a catheter is wide."""
_RINGS = 24
"""Of a drawn stone: its way differs from a ball's by 1 - cos(pi / 48), 0.2 %."""


class Cholangioscope(Fluoroscope):
    """Draws layouts and pictures as `Fluoroscope` does, with contrast agent in the lumen.

    Args:
        size: Width and height in pixels.
        shut: Names of rims that are tied, so that nothing flows out there: ``mouth`` or ``clamped``.
    """

    def __init__(self, size: tuple[int, int] = (800, 600), shut: frozenset[str] = frozenset()) -> None:
        super().__init__(size)
        self._shut = shut
        self._rest_m: Float32Array | None = None
        self._tick = 0

    def update(self, layout: PictureLayout, picture: Picture) -> None:
        """Let the agent flow from the last picture to this one, and add up what weakens each ray."""
        super().update(layout, picture)
        if not len(layout.mouth):
            return
        if layout.rest_m is not self._rest_m or picture.tick < self._tick:
            self._begin(layout, picture.tick)
        inner_m = self._wall_m[self._wall.n_middle : 2 * self._wall.n_middle]
        tip_m = picture.centreline_m[-1:].astype(float)
        lumen = Lumen(self._cells, self._cells.corners_m(inner_m), displacers(layout, picture), tip_m)
        self._flow_to(picture.tick, lumen)
        self._draw_contrast(lumen)

    def _begin(self, layout: PictureLayout, tick: int) -> None:
        self._rest_m, self._tick = layout.rest_m, tick
        wall_m, normals = np.zeros((2, self._wall.n_points, 3), np.float32)
        self._wall.update(layout.rest_m, wall_m, normals)
        self._cells = LumenCells(wall_m[: self._wall.n_middle], self._wall.outer, np.array(layout.mouth), EDGE_M)
        self.flow = ContrastFlow(self._cells.n)
        tied = {node for name in self._shut for node in getattr(layout, name)}
        ends = zip(self._cells.openings, self._cells.opening_cells, strict=True)
        self._outlets = np.array([cell for rim, cells in ends if not tied & set(rim.tolist()) for cell in cells], int)

    def _flow_to(self, tick: int, lumen: Lumen) -> None:
        """Inject up to a tick, at the catheter's tip."""
        passed_s, self._tick = (tick - self._tick) * TICK_S, tick
        if passed_s <= 0.0 or lumen.tip is None:
            return
        channel, steps = lumen.channel(self._outlets), int(np.ceil(passed_s / _LONGEST_S))
        for _ in range(steps):
            self.flow.inject(channel, lumen.tip, RATE_M3_S, passed_s / steps)

    def _draw_contrast(self, lumen: Lumen) -> None:
        """Add what the agent weakens, less what bodies displace of it."""
        share, cells = self.flow.share, lumen.cells
        for cell in np.flatnonzero(share > 0.0):
            self._add(CONTRAST_1_M * share[cell], lumen.corners_m, cells.triangles[cells.cell == cell])
        for cap in cells.borders:
            if (step := share[cap.inner] - share[cap.outer]) != 0.0:
                corners_m = fan_m(lumen.corners_m, cap.edges)
                fan = np.arange(3 * len(corners_m), dtype=np.int32).reshape(-1, 3)
                self._add(CONTRAST_1_M * step, corners_m.reshape(-1, 3), fan)
        for body, inside in zip(lumen.bodies, lumen.cells_of_bodies, strict=True):
            if (around := float(np.mean(share[inside]))) > 0.0:
                self._add(-CONTRAST_1_M * around, body.surface_m, body.triangles)


@dataclass(frozen=True)
class Displacer:
    """A body that is in the lumen as a whole or not at all, as its middle (3,) is, with its closed surface.

    Places (k, 3) share its volume and its wetted area alike.
    """

    middle_m: FloatArray
    places_m: FloatArray
    volume_m3: float
    area_m2: float
    surface_m: Float32Array
    triangles: IntArray


class Lumen:
    """The cells of a lumen as the wall is now, the bodies in it, and the cell of a tip (1, 3), or of none (0, 3).

    Attributes:
        bodies: Those of the bodies that are in the lumen.
        cells_of_bodies: For each of them the cells of its places.
        tip: The tip's cell, None outside.
    """

    def __init__(self, cells: LumenCells, corners_m: FloatArray, bodies: list[Displacer], tip_m: FloatArray) -> None:
        self.cells, self.corners_m = cells, corners_m
        inside = cells.contains(corners_m, np.concatenate([tip_m, *(body.middle_m[None] for body in bodies)]))
        tips, of_bodies = np.split(inside, [len(tip_m)])
        self.bodies = [body for body, is_inside in zip(bodies, of_bodies, strict=True) if is_inside]
        ends = np.cumsum([len(tip_m), *(len(body.places_m) for body in self.bodies)])
        places_m = np.concatenate([tip_m, *(body.places_m for body in self.bodies)])
        tip, *self.cells_of_bodies = np.split(cells.nearest_cells(corners_m, places_m), ends[:-1])
        self.tip = int(tip[0]) if tips.any() else None

    def channel(self, outlets: IntArray) -> Channel:
        """Return what bodies leave of the cells for a fluid that leaves through ``outlets``."""
        walls_m2 = self.cells.wall_areas_m2(self.corners_m)
        filled_m3, wetted_m2 = np.zeros(self.cells.n), walls_m2.copy()
        for body, inside in zip(self.bodies, self.cells_of_bodies, strict=True):
            there = np.bincount(inside, minlength=self.cells.n) / len(inside)
            filled_m3 += body.volume_m3 * there
            wetted_m2 += body.area_m2 * there
        volume_m3 = free_channel(self.cells.volumes_m3(self.corners_m), filled_m3)
        links = np.array([(cap.inner, cap.outer) for cap in self.cells.borders], int).reshape(-1, 2)
        return Channel(volume_m3, wetted_m2, self._lengths_m(walls_m2), links, outlets)

    def _lengths_m(self, walls_m2: FloatArray) -> FloatArray:
        """Return how far it is through each cell: between those two of its ends that are farthest apart."""
        ends: list[list[FloatArray]] = [[] for _ in range(self.cells.n)]
        for cap, middle_m in zip(self.cells.borders, self.cells.border_middles_m(self.corners_m), strict=True):
            ends[cap.inner].append(middle_m)
            ends[cap.outer].append(middle_m)
        for rim, cells in zip(self.cells.openings, self.cells.opening_cells, strict=True):
            for cell in cells:
                ends[cell].append(self.corners_m[rim].mean(axis=0))
        return np.array([_farthest_m(np.array(each), area) for each, area in zip(ends, walls_m2, strict=True)])


def _farthest_m(places_m: FloatArray, area_m2: float) -> float:
    """Return the largest distance between places (k, 3); of a blind cell, which has one, its wall's size."""
    if len(places_m) < 2:
        return float(np.sqrt(area_m2))
    return float(np.linalg.norm(places_m[:, None] - places_m[None], axis=2).max())


def displacers(layout: PictureLayout, picture: Picture) -> list[Displacer]:
    """Return the segments of catheter and wire, and the stones."""
    line_m = picture.centreline_m.astype(float)
    bodies = [
        _segment(ends_m, radius_m)
        for part, radius_m in layout.rods()
        for ends_m in np.lib.stride_tricks.sliding_window_view(line_m[part], 2, axis=0).transpose(0, 2, 1)
    ]
    balls = zip(picture.stones_m.astype(float), layout.stone_radii_m, strict=False)
    return bodies + [_ball(middle_m, radius_m) for middle_m, radius_m in balls]


def _segment(ends_m: FloatArray, radius_m: float) -> Displacer:
    length_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
    count = max(int(np.ceil(length_m / _SAMPLE_M)), 1)
    along = (np.arange(count) + 0.5)[:, None] / count
    places_m = ends_m[0] + along * (ends_m[1] - ends_m[0])
    surface_m, triangles = rod(ends_m, np.full(2, radius_m))
    area_m2 = 2.0 * np.pi * radius_m * length_m
    return Displacer(ends_m.mean(axis=0), places_m, 0.5 * area_m2 * radius_m, area_m2, surface_m, triangles)


def _ball(middle_m: FloatArray, radius_m: float) -> Displacer:
    count = int(np.ceil(2.0 * radius_m / _SAMPLE_M))
    across = (2.0 * np.arange(count) + 1.0) / count - 1.0
    lattice = np.stack(np.meshgrid(across, across, across, indexing="ij"), axis=-1).reshape(-1, 3)
    places_m = middle_m + radius_m * lattice[np.linalg.norm(lattice, axis=1) < 1.0]
    angle = np.linspace(0.0, np.pi, _RINGS + 1)
    line_m = middle_m + radius_m * np.cos(angle)[:, None] * np.array([-1.0, 0.0, 0.0])
    surface_m, triangles = rod(line_m, radius_m * np.sin(angle))
    area_m2 = 4.0 * np.pi * radius_m**2
    return Displacer(middle_m, places_m, area_m2 * radius_m / 3.0, area_m2, surface_m, triangles)
