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
class Channel:
    """The way of the fluid through n cells.

    Attributes:
        volume_m3, wetted_m2, length_m: (n,). Of each cell: what is left to the fluid, what it touches, how far it goes.
        links: (b, 2). Cells between which it may flow.
        outlets: Cells from which it leaves, once for each opening.
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


def free_channel(volume_m3: FloatArray, filled_m3: FloatArray) -> FloatArray:
    """Return what bodies leave of each cell's volume, never nothing."""
    return np.maximum(volume_m3 - filled_m3, _ROOM * volume_m3)


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

    def inject(self, channel: Channel, cell: int, rate_m3_s: float, duration_s: float) -> None:
        """Inject into a cell at a rate for so long; without an outlet nothing moves."""
        if not len(channel.outlets):
            return
        pressure, out = _solve_pressures(channel, cell, rate_m3_s)
        flow, half = np.zeros((len(pressure), len(pressure))), channel.half_resistances()
        for a, b in channel.links:  # flow[i, j]: from i to j
            passes = (pressure[a] - pressure[b]) / (half[a] + half[b])
            flow[(a, b) if passes > 0.0 else (b, a)] += abs(passes)
        held = channel.volume_m3 / duration_s
        matrix = np.diag(held + flow.sum(axis=1) + out) - flow.T
        right = held * self.share
        right[cell] += rate_m3_s
        self.share = np.linalg.solve(matrix, right).astype(float)
        self.injected_m3 += rate_m3_s * duration_s
        self.left_m3 += float(out @ self.share) * duration_s


def _solve_pressures(channel: Channel, cell: int, rate_m3_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the pressure in each cell (n,), that outside being zero, and the flow out of it through openings (n,)."""
    half = channel.half_resistances()
    matrix, open_to = np.zeros((len(half), len(half))), np.zeros(len(half))
    for a, b in channel.links:
        passes = 1.0 / (half[a] + half[b])
        matrix[[a, b, a, b], [a, b, b, a]] += passes, passes, -passes, -passes
    np.add.at(open_to, channel.outlets, 1.0 / half[channel.outlets])
    matrix += np.diag(open_to)
    right = np.zeros(len(half))
    right[cell] = rate_m3_s
    pressure: FloatArray = np.linalg.solve(matrix, right).astype(float)
    outflow: FloatArray = open_to * np.maximum(pressure, 0.0)
    return pressure, outflow
