"""Contrast agent that is injected into the cells of a lumen: one-dimensional flow, and mixing within each cell.

Between the middles of two cells the flow is that of Poiseuille in a channel of the cells' hydraulic diameter 4 V / S,
of volume V and wetted surface S, a catheter's and stones' included. Pressures then solve Kirchhoff's law. As the
injection prescribes the flow, the viscosity drops out. Contrast is carried upwind, implicitly: no concentration passes
that of the agent or falls below zero at any step, and what flows in is what is there and what has flowed out, to
rounding. Upwind cells mix along the way as a diffusion of half a cell's length times the speed would; Taylor's
dispersion in a duct of some millimetres, which is not modelled, mixes more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray

_ROOM = 1e-3
"""Least share of a cell that is left to the fluid, where a catheter or a stone fills it: then next to nothing flows."""


@dataclass(frozen=True)
class FlowChannel:
    """The way of the fluid through n cells.

    Attributes:
        volume_m3, wetted_m2, length_m: (n,). Of each cell: what is left to the fluid, what it touches, how far it goes.
        links: (b, 2). Cells between which it may flow.
        outlets: (o,). Cells from which it leaves, once for each opening.
    """

    volume_m3: FloatArray
    wetted_m2: FloatArray
    length_m: FloatArray
    links: IntArray
    outlets: IntArray

    def half_resistances(self) -> FloatArray:
        """Return the resistance (n,) of half of each cell, up to a factor that all have in common, in 1/m3.

        Of 32 mu L / (A D^2) with A = V / L and D = 4 V / S.
        """
        diameter_m = 4.0 * self.volume_m3 / self.wetted_m2
        resistance: FloatArray = 0.5 * self.length_m**2 / (self.volume_m3 * diameter_m**2)
        return resistance


def free_volumes_m3(volume_m3: FloatArray, filled_m3: FloatArray) -> FloatArray:
    """Return what bodies leave of each cell's volume, never nothing."""
    return np.maximum(volume_m3 - filled_m3, _ROOM * volume_m3)


@dataclass(frozen=True)
class SteadyFlow:
    """What flows through a channel while something is injected into one of its cells; in m3/s.

    Attributes:
        cell, rate_m3_s: Where, and how much is injected; none where the channel has no outlet.
        through_m3_s: (b,). From the first to the second cell of each link, negative the other way.
        out_m3_s: (o,). Through each outlet.
    """

    channel: FlowChannel
    cell: int
    rate_m3_s: float
    through_m3_s: FloatArray
    out_m3_s: FloatArray


def steady_flow(channel: FlowChannel, cell: int, rate_m3_s: float) -> SteadyFlow:
    """Return the flow that an injection drives: pressures by Kirchhoff's law, zero outside of the outlets."""
    if not len(channel.outlets):
        return SteadyFlow(channel, cell, 0.0, np.zeros(len(channel.links)), np.zeros(0))
    half = channel.half_resistances()
    first, second = channel.links.T
    passes, leaves = 1.0 / (half[first] + half[second]), 1.0 / half[channel.outlets]
    matrix = np.zeros((len(half), len(half)))
    for row, column, value in (
        (first, first, passes), (second, second, passes), (first, second, -passes), (second, first, -passes),
        (channel.outlets, channel.outlets, leaves),
    ):  # fmt: skip
        np.add.at(matrix, (row, column), value)
    right = np.zeros(len(half))
    right[cell] = rate_m3_s
    pressure: FloatArray = np.linalg.solve(matrix, right).astype(float)
    through_m3_s: FloatArray = passes * (pressure[first] - pressure[second])
    out_m3_s: FloatArray = leaves * np.maximum(pressure[channel.outlets], 0.0)  # below zero only by rounding
    return SteadyFlow(channel, cell, rate_m3_s, through_m3_s, out_m3_s)


class ContrastFlow:
    """Shares of contrast in the cells of a lumen.

    Args:
        n: Number of cells.

    Attributes:
        share: (n,). Of the agent's own concentration, 0 to 1.
        injected_m3, left_m3: Agent that has been injected, and that has left through openings.
    """

    def __init__(self, n: int) -> None:
        self.share: FloatArray = np.zeros(n)
        self.injected_m3 = self.left_m3 = 0.0

    def inject(self, flow: SteadyFlow, duration_s: float) -> None:
        """Inject agent for so long, and carry what is there with the flow."""
        channel, n = flow.channel, len(self.share)
        held = channel.volume_m3 / duration_s
        carried = np.zeros((n, n))  # [i, j]: from cell i to cell j
        first, second = channel.links.T
        np.add.at(carried, (first, second), np.maximum(flow.through_m3_s, 0.0))
        np.add.at(carried, (second, first), np.maximum(-flow.through_m3_s, 0.0))
        out = np.bincount(channel.outlets, flow.out_m3_s, n)
        matrix = np.diag(held + carried.sum(axis=1) + out) - carried.T
        right = held * self.share
        right[flow.cell] += flow.rate_m3_s
        self.share = np.linalg.solve(matrix, right).astype(float)
        self.injected_m3 += flow.rate_m3_s * duration_s
        self.left_m3 += float(out @ self.share) * duration_s
