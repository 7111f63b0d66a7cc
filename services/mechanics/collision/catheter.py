"""Contacts of the catheter with the wall of the duct, from inside or outside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.inside import Lumen, LumenState, cap_clearance, follow_caps, lumen_at
from services.mechanics.collision.primitives import Vector, vector
from services.mechanics.collision.probes import (
    EARLY_SEARCHES,
    MINIMA,
    SKIN_M,
    Probes,
    ProbeSet,
    advance,
    forget,
    is_near,
    probes_at,
)
from services.mechanics.collision.rim import RimSegments, detect_rims, memory_at
from services.mechanics.collision.search import NOTHING
from services.mechanics.collision.sides import INSIDE, OUTSIDE, UNKNOWN
from services.mechanics.collision.surface import DuctSurface, Shell, shell_at
from services.mechanics.collision.writer import PairWriter, Rows, rows_at, write_pair
from services.mechanics.contact.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs
from services.mechanics.kernel import flags, floats, ints, kernel
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
        self._shape = (n_particles, 3)
        self._probes = ProbeSet(n_particles)
        self._lumen = LumenState(n_particles)
        self._rims = RimSegments(max(n_particles - 1, 0))
        self._writer = PairWriter()

    @property
    def inside(self) -> npt.NDArray[np.int8]:
        """(n,) one where a particle is in the lumen; a live view."""
        return self._lumen.inside

    def reset(self) -> None:
        """Forget the past: the next `detect` finds sides and insideness from the positions alone."""
        self._probes.reset()
        self._lumen.reset()
        self._rims.reset()

    def detect(self, particle_positions_m: FloatArray, pairs_out: ContactPairs) -> None:
        """Append the pairs of this tick for positions (n, 3).

        At most two a particle, and one a segment where it crosses the rim of an opening between its particles.
        """
        if particle_positions_m.shape != self._shape:
            raise ValueError(f"particle positions have shape {particle_positions_m.shape}, not {self._shape}")
        state = (self._probes.address, self._lumen.address, self._rims.address)
        sizes = (self._thickness_m, self._margin_m)
        _detect(self.surface.address, state, particle_positions_m, sizes, self._writer.open(pairs_out))
        self._writer.close()


@kernel
def _detect(
    shell_address: int,
    state: tuple[int, int, int],
    positions: FloatArray,
    sizes: tuple[float, float],
    rows_address: int,
) -> None:
    """Detect everything; ``state`` holds the addresses of probes, lumen and rims."""
    shell, rows = shell_at(shell_address), rows_at(rows_address)
    _detect_particles(shell, probes_at(state[0]), lumen_at(state[1]), positions, sizes, rows)
    detect_rims(shell, memory_at(state[2]), positions, sizes, rows)


@kernel
def _detect_particles(
    shell: Shell,
    probes: Probes,
    lumen: Lumen,
    positions: FloatArray,
    sizes: tuple[float, float],
    rows: Rows,
) -> None:
    thickness, margin = sizes
    probes.early = EARLY_SEARCHES
    for i in range(positions.shape[0]):
        p = (positions[i, 0], positions[i, 1], positions[i, 2])
        if not is_near(p):
            forget(probes, i)
            continue
        _follow_particle(shell, probes, lumen, i, p, thickness + margin)
        for row in range(MINIMA * i, MINIMA * (i + 1)):
            gap = floats(probes.distance)[row] - thickness
            if ints(probes.triangle)[row] != NOTHING and gap < margin:
                place, triangle = floats(probes.place), ints(probes.triangle)[row]
                weights = (place[4 * row + 1], place[4 * row + 2], place[4 * row + 3])
                pair = (NO_TOOL, 0, i, DUCT_TRIANGLE, triangle, 0.0, weights)
                write_pair(rows, pair, gap, vector(floats(probes.normal), row))


@kernel
def _follow_particle(shell: Shell, probes: Probes, lumen: Lumen, i: int, p: Vector, reach: float) -> None:
    """Update flag and minima of one particle; each vouches for the other where it alone can know."""
    inside, triangle = flags(lumen.inside), ints(probes.triangle)
    follow_caps(shell, lumen, i, vector(floats(probes.ends), 2 * i), p, triangle[MINIMA * i])
    hint = UNKNOWN
    if cap_clearance(shell.body, lumen, i, p) > reach + SKIN_M:
        hint = INSIDE if inside[i] else OUTSIDE
    advance(shell.body, shell.wall, probes, i, (p, p), reach, hint)
    distance, side = floats(probes.distance)[MINIMA * i], flags(probes.side)[MINIMA * i]
    if triangle[MINIMA * i] == NOTHING or side == UNKNOWN or distance <= 0.0:
        return
    if cap_clearance(shell.body, lumen, i, p) > distance:
        inside[i] = 1 if side == INSIDE else 0
