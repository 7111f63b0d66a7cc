"""Contacts of the catheter with the wall of the duct, from inside or outside."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.folds import flank_on, is_new_flank, may_be_flank
from services.mechanics.collision.inside import Lumen, LumenState, cap_clearance, follow_caps, lumen_at
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs
from services.mechanics.collision.primitives import vector
from services.mechanics.collision.probes import (
    EARLY_SEARCHES,
    MINIMA,
    SKIN_M,
    Probes,
    ProbeSet,
    advance,
    forget,
    is_near,
    motion_to,
    probes_at,
)
from services.mechanics.collision.rim import RimSegments, detect_rims, memory_at
from services.mechanics.collision.search import NOTHING, walk
from services.mechanics.collision.sides import INSIDE, OUTSIDE, UNKNOWN, Contact, settle
from services.mechanics.collision.surface import DuctSurface, Shell, shell_at
from services.mechanics.collision.writer import PairWriter, Rows, is_due, rows_at, write_pair
from services.mechanics.compiled import flags, floats, ints, kernel
from services.mechanics.compiled.vectors import Vector, along, dot

# A flank of 12 degrees is in sight from 0.21 of the thickness before the fold on. Who moves further than that in a tick
# also looks for flanks from where it will be.
UNSEEN = 0.21
STILL = (0.0, 0.0, 0.0)


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

        Of a particle with the wall and of a segment where it crosses the rim of an opening between its particles: with
        the closest point, with what lies opposite, and with the other flanks of the folds that these lie in.
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
    shell, probes, rows = shell_at(shell_address), probes_at(state[0]), rows_at(rows_address)
    # Rims first: they still find in the probes where the particles were in the last tick.
    detect_rims(shell, memory_at(state[2]), probes, positions, sizes, rows)
    _detect_particles(shell, probes, lumen_at(state[1]), positions, sizes, rows)


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
        motion, start = motion_to(probes, i, p), rows.used
        moved = math.sqrt(dot(motion, motion))
        reach = thickness + margin + moved
        _follow_particle(shell, probes, lumen, i, p, (thickness + margin, reach))
        is_touched = False
        for row in range(MINIMA * i, MINIMA * (i + 1)):
            is_touched = _write_minimum(probes, row, sizes, motion, rows) or is_touched
        for row in range(MINIMA * i, MINIMA * (i + 1)):
            if is_touched and ints(probes.triangle)[row] != NOTHING:
                _write_flanks(shell, probes, row, (p, STILL), motion, (thickness, margin, reach), rows, start)
                if moved > UNSEEN * thickness:
                    _write_flanks(shell, probes, row, (p, motion), motion, (thickness, margin, reach), rows, start)


@kernel
def _write_minimum(probes: Probes, row: int, sizes: tuple[float, float], motion: Vector, rows: Rows) -> bool:
    """Append the pair of a minimum, if it is due, and return whether it is."""
    triangle, normal = ints(probes.triangle)[row], vector(floats(probes.normal), row)
    gap = floats(probes.distance)[row] - sizes[0]
    if triangle == NOTHING or not is_due(gap, normal, motion, sizes[1]):
        return False
    place = floats(probes.place)
    weights = (place[4 * row + 1], place[4 * row + 2], place[4 * row + 3])
    write_pair(rows, (NO_TOOL, 0, row // MINIMA, DUCT_TRIANGLE, triangle, 0.0, weights), gap, normal)
    return True


@kernel
def _write_flanks(
    shell: Shell,
    probes: Probes,
    found: int,
    place: tuple[Vector, Vector],
    motion: Vector,
    sizes: tuple[float, float, float],
    rows: Rows,
    start: int,
) -> None:
    """Append pairs with the other flanks of the fold that the minimum ``found`` of a particle lies in; see `folds`.

    ``place`` holds the particle and how far ahead of it to look.
    """
    body, wall, (p, ahead) = shell.body, shell.wall, place
    triangle, side, q = ints(probes.triangle)[found], flags(probes.side)[found], along(p, ahead, 1.0)
    middle = triangle
    if dot(ahead, ahead) > 0.0:
        middle = walk(body, wall, triangle, q, q, sizes[2])[0]
    if middle == NOTHING:
        return
    begin, ring, normal = ints(wall.ring_start), ints(wall.ring), vector(floats(probes.normal), found)
    for corner in range(3):
        vertex = ints(wall.triangles)[3 * middle + corner]
        for k in range(begin[vertex], begin[vertex + 1]):
            if not may_be_flank(body, wall, ring[k], normal):
                continue
            touch = flank_on(body, wall, triangle, ring[k], (q, q), sizes[2])
            if touch[0] != NOTHING:
                contact = settle(body, wall, touch, q, q, side)
                _write_flank(found // MINIMA, contact, ahead, motion, sizes, rows, start)


@kernel
def _write_flank(
    i: int,
    contact: Contact,
    ahead: Vector,
    motion: Vector,
    sizes: tuple[float, float, float],
    rows: Rows,
    start: int,
) -> None:
    """Append the pair of a flank as seen from ``ahead`` of a particle, if it is due.

    What lies ahead cannot overlap yet: a plane that seems to is that of a flank round a corner, which is not there
    where the particle is.
    """
    touch, normal, distance, _ = contact
    distance -= dot(ahead, normal)
    least = sizes[0] if dot(ahead, ahead) > 0.0 else 0.0
    is_near_it = distance > least and is_due(distance - sizes[0], normal, motion, sizes[1])
    if is_near_it and is_new_flank(rows, start, normal):
        write_pair(rows, (NO_TOOL, 0, i, DUCT_TRIANGLE, touch[0], 0.0, touch[3]), distance - sizes[0], normal)


@kernel
def _follow_particle(
    shell: Shell, probes: Probes, lumen: Lumen, i: int, p: Vector, reaches: tuple[float, float]
) -> None:
    """Update flag and minima of one particle; each vouches for the other where it alone can know.

    ``reaches`` is how far it looks on its way to p and how far from there.
    """
    inside, triangle = flags(lumen.inside), ints(probes.triangle)
    follow_caps(shell, lumen, i, vector(floats(probes.ends), 2 * i), p, triangle[MINIMA * i])
    clearance, side = cap_clearance(shell.body, lumen, i, p), INSIDE if inside[i] else OUTSIDE
    on_the_way = (reaches[0], side if clearance > reaches[0] + SKIN_M else UNKNOWN)
    there = (reaches[1], side if clearance > reaches[1] + SKIN_M else UNKNOWN)
    advance(shell.body, shell.wall, probes, i, (p, p), on_the_way, there)
    distance, side = floats(probes.distance)[MINIMA * i], flags(probes.side)[MINIMA * i]
    if triangle[MINIMA * i] == NOTHING or side == UNKNOWN or distance <= 0.0:
        return
    if cap_clearance(shell.body, lumen, i, p) > distance:
        inside[i] = 1 if side == INSIDE else 0
