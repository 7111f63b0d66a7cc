"""Contacts of the catheter's particles with the wall of the duct, from inside or outside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.inside import Insideness, cap_clearance, follow_caps, make_insideness
from services.mechanics.collision.kernel import kernel
from services.mechanics.collision.primitives import Vector
from services.mechanics.collision.probes import (
    EARLY_SEARCHES,
    MINIMA,
    SKIN_M,
    Probes,
    advance,
    end_of,
    forget,
    make_probes,
)
from services.mechanics.collision.search import NOTHING
from services.mechanics.collision.sides import INSIDE, OUTSIDE, UNKNOWN
from services.mechanics.collision.surface import DuctSurface, Shell
from services.mechanics.collision.writer import FULL, PairRows, PairWriter, take_row
from services.mechanics.contact.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs
from services.mechanics.mesh import FloatArray


class CatheterContactDetector:
    """Finds pairs of catheter particles and duct triangles, and follows who is in the lumen.

    Parameters
    ----------
    surface : DuctSurface
        Updated by the caller before every `detect`.
    n_particles : int
    radius_m : float
        Radius of influence of a particle: that of the catheter.
    margin_m : float
        Pairs are reported from this gap on, so that the solver meets a contact before it happens.
    """

    def __init__(self, surface: DuctSurface, n_particles: int, radius_m: float, margin_m: float) -> None:
        if not (radius_m > 0.0 and margin_m > 0.0):
            raise ValueError(f"radius_m and margin_m must be positive, got {radius_m} and {margin_m}")
        self.surface = surface
        self._thickness_m = radius_m + surface.half_thickness_m
        self._margin_m = margin_m
        self._probes = make_probes(n_particles)
        self._state = make_insideness(n_particles)
        self._writer = PairWriter()

    @property
    def inside(self) -> npt.NDArray[np.int8]:
        """(n,) one where a particle is in the lumen; a live view."""
        return self._state.inside

    def reset(self) -> None:
        """Forget the past: the next `detect` finds sides and insideness from the positions alone."""
        self._probes.slack.fill(-1.0)
        self._state.clearance.fill(-1.0)

    def detect(self, particle_positions_m: FloatArray, pairs_out: ContactPairs) -> None:
        """Append the pairs of this tick, at most two a particle, for positions (n, 3)."""
        rows = self._writer.open(pairs_out)
        sizes = (self._thickness_m, self._margin_m)
        _detect(self.surface.shell, self._probes, self._state, particle_positions_m, sizes, rows)
        self._writer.close()


@kernel
def _detect(
    shell: Shell,
    probes: Probes,
    state: Insideness,
    positions: FloatArray,
    sizes: tuple[float, float],
    rows: PairRows,
) -> None:
    thickness, margin = sizes
    probes.early[0] = EARLY_SEARCHES
    for i in range(positions.shape[0]):
        p = (positions[i, 0], positions[i, 1], positions[i, 2])
        if p[0] + p[1] + p[2] != p[0] + p[1] + p[2]:
            forget(probes, i)
            continue
        _follow_particle(shell, probes, state, i, p, thickness + margin)
        for k in range(MINIMA):
            gap = probes.distance[i, k] - thickness
            if probes.triangle[i, k] != NOTHING and gap < margin:
                _write_particle(probes, i, k, gap, rows)


@kernel
def _follow_particle(shell: Shell, probes: Probes, state: Insideness, i: int, p: Vector, reach: float) -> None:
    """Update flag and minima of one particle; each vouches for the other where it alone can know."""
    follow_caps(shell, state, i, end_of(probes.ends, i, 0), p, probes.triangle[i, 0])
    hint = UNKNOWN
    if cap_clearance(shell.body, state, i, p) > reach + SKIN_M:
        hint = INSIDE if state.inside[i] else OUTSIDE
    advance(shell.body, shell.wall, probes, i, p, p, reach, hint)
    distance, side = probes.distance[i, 0], probes.side[i, 0]
    if probes.triangle[i, 0] == NOTHING or side == UNKNOWN or distance <= 0.0:
        return
    if cap_clearance(shell.body, state, i, p) > distance:
        state.inside[i] = 1 if side == INSIDE else 0


@kernel
def _write_particle(probes: Probes, i: int, k: int, gap: float, rows: PairRows) -> None:
    normal = (probes.normal[i, k, 0], probes.normal[i, k, 1], probes.normal[i, k, 2])
    row = take_row(rows, gap, normal)
    if row == FULL:
        return
    rows.tool[row] = NO_TOOL
    rows.tool_segment[row] = 0
    rows.particle[row] = i
    rows.target_kind[row] = DUCT_TRIANGLE
    rows.target[row] = probes.triangle[i, k]
    rows.tool_parameter[row] = 0.0
    for corner in range(3):
        rows.target_weights[row, corner] = probes.place[i, k, 1 + corner]
