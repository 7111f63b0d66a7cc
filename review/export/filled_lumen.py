"""A lumen as the wall is now, with the bodies in it: what they leave to a fluid, and how that flows."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from trocar.review.export.contrast_flow import FlowChannel, SteadyFlow, free_volumes_m3
from trocar.review.export.displacers import Displacer
from trocar.review.export.lumen_cells import LumenCells
from trocar.services.mechanics.arrays import FloatArray, IntArray


class FilledLumen:
    """The cells of a lumen, the bodies in it, and the cell of a catheter's tip.

    Args:
        corners_m: (k, 3). Vertices of the cells, by `LumenCells.corners_m`.
        bodies: Those that may be in it.
        tip_m: (1, 3). The tip; (0, 3) where there is none.
        outlets: (o, 2). Openings and cells through which the fluid leaves.

    Attributes:
        bodies: Those of the bodies that are in the lumen.
        cells_of_bodies: For each of them the cells of its places.
        tip: The tip's cell, None outside.
    """

    def __init__(
        self, cells: LumenCells, corners_m: FloatArray, bodies: list[Displacer], tip_m: FloatArray, outlets: IntArray
    ) -> None:
        self.cells, self.corners_m, self.outlets, self._tip_m = cells, corners_m, outlets, tip_m
        inside = cells.contains(corners_m, np.concatenate([tip_m, *(body.middle_m[None] for body in bodies)]))
        tips, of_bodies = np.split(inside, [len(tip_m)])
        self.bodies = [body for body, is_inside in zip(bodies, of_bodies, strict=True) if is_inside]
        ends = np.cumsum([len(tip_m), *(len(body.places_m) for body in self.bodies)])
        places_m = np.concatenate([tip_m, *(body.places_m for body in self.bodies)])
        tip, *self.cells_of_bodies = np.split(self.cells_at(places_m), ends[:-1])
        self.tip = int(tip[0]) if tips.any() else None

    def cells_at(self, places_m: FloatArray) -> IntArray:
        """Return the cell whose wall is nearest to each place (k, 3)."""
        _, nearest = self._vertices.query(places_m)
        cells: IntArray = self.cells.cell_of_vertex[nearest]
        return cells

    @cached_property
    def radii_m(self) -> FloatArray:
        """Radius (n,) of a round tube of each cell's volume and wall, without bodies."""
        radii_m: FloatArray = 2.0 * self._volumes_m3 / self._walls_m2
        return radii_m

    @cached_property
    def channel(self) -> FlowChannel:
        """What bodies leave of the cells."""
        filled_m3, wetted_m2 = np.zeros(self.cells.n), self._walls_m2.copy()
        for body, inside in zip(self.bodies, self.cells_of_bodies, strict=True):
            there = np.bincount(inside, minlength=self.cells.n) / len(inside)
            filled_m3 += body.volume_m3 * there
            wetted_m2 += body.area_m2 * there
        volume_m3 = free_volumes_m3(self._volumes_m3, filled_m3)
        links = np.array([(cap.inner, cap.outer) for cap in self.cells.borders], int).reshape(-1, 2)
        return FlowChannel(volume_m3, wetted_m2, self._lengths_m(), links, self.outlets[:, 1])

    def velocities_m_s(self, flow: SteadyFlow) -> FloatArray:
        """Return the mean velocity (n, 3) of the fluid over each cell.

        By the divergence theorem the integral of the velocity over a cell is that of the place times the flow out of
        its surface, less the place of a source times what comes from it.
        """
        borders_m = self.cells.border_middles_m(self.corners_m)
        moment = np.zeros((self.cells.n, 3))
        np.add.at(moment, flow.channel.links[:, 0], flow.through_m3_s[:, None] * borders_m)
        np.add.at(moment, flow.channel.links[:, 1], -flow.through_m3_s[:, None] * borders_m)
        for (opening, cell), out_m3_s in zip(self.outlets, flow.out_m3_s, strict=True):
            moment[cell] += out_m3_s * self.cells.end_middle_m(self.corners_m, opening, cell)
        if self.tip is not None:
            moment[self.tip] -= flow.rate_m3_s * self._tip_m[0]
        velocities_m_s: FloatArray = moment / flow.channel.volume_m3[:, None]
        return velocities_m_s

    @cached_property
    def _vertices(self) -> KDTree:
        return KDTree(self.corners_m[: len(self.cells.cell_of_vertex)])

    @cached_property
    def _volumes_m3(self) -> FloatArray:
        return self.cells.volumes_m3(self.corners_m)

    @cached_property
    def _walls_m2(self) -> FloatArray:
        return self.cells.wall_areas_m2(self.corners_m)

    def _lengths_m(self) -> FloatArray:
        """Return how far it is through each cell: between those two of its ends that are farthest apart."""
        ends: list[list[FloatArray]] = [[] for _ in range(self.cells.n)]
        for cap, middle_m in zip(self.cells.borders, self.cells.border_middles_m(self.corners_m), strict=True):
            ends[cap.inner].append(middle_m)
            ends[cap.outer].append(middle_m)
        for rim, cells in zip(self.cells.openings, self.cells.opening_cells, strict=True):
            for cell in cells:
                ends[cell].append(self.corners_m[rim].mean(axis=0))
        return np.array([_farthest_m(np.array(each), area) for each, area in zip(ends, self._walls_m2, strict=True)])


def _farthest_m(places_m: FloatArray, area_m2: float) -> float:
    """Return the largest distance between places (k, 3); of a blind cell, which has one, its wall's size."""
    if len(places_m) < 2:
        return float(np.sqrt(area_m2))
    return float(np.linalg.norm(places_m[:, None] - places_m[None], axis=2).max())
