"""Contacts of the forceps' shafts and jaws with the wall of the duct and with the catheter."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.capsules import CapsuleMemory, Tools, detect_capsules, memory_at, segment_ends
from services.mechanics.collision.pairs import DUCT_TRIANGLE, SHAFT, ContactPairs
from services.mechanics.collision.primitives import clamp01, vector
from services.mechanics.collision.probes import EARLY_SEARCHES, MINIMA, Probes, ProbeSet, advance, forget, probes_at
from services.mechanics.collision.search import NOTHING
from services.mechanics.collision.sides import UNKNOWN
from services.mechanics.collision.surface import DuctSurface, Shell, shell_at
from services.mechanics.collision.writer import PairWriter, Rows, rows_at, write_pair
from services.mechanics.compiled import floats, ints, kernel
from services.mechanics.compiled.vectors import Vector, along, dot, scaled, squared_distance, subtract

N_SEGMENTS = 3
# Probes per segment. The shaft's are of PIECE_M, counted from the junction, the last reaching to the port: they
# stay where they are in the instrument while it slides through the port. A jaw's share the jaw.
SHAFT_PROBES, JAW_PROBES = 13, 5
PROBES_PER_TOOL = SHAFT_PROBES + 2 * JAW_PROBES
PIECE_M = 5e-3
# Cosine between normals from which two contacts at one place count as the same.
SAME_WAY = 0.5


class ToolContactDetector:
    """Finds pairs of tool segments with duct triangles and catheter segments.

    A segment is cut into probes with one or two contacts each, so that one lying along the wall is carried by a
    few well spread points that stay where they are from tick to tick.

    Parameters
    ----------
    surface : DuctSurface
        Updated by the caller before every `detect`.
    n_particles : int
        Particles of the catheter, one more than its segments; 0 without a catheter.
    catheter_radius_m : float
    margin_m : float
        Pairs are reported from this gap on.
    n_tools : int
    """

    def __init__(
        self,
        surface: DuctSurface,
        n_particles: int,
        catheter_radius_m: float,
        margin_m: float,
        n_tools: int = 2,
    ) -> None:
        if not margin_m > 0.0:
            raise ValueError(f"margin_m must be positive, got {margin_m}")
        self.surface = surface
        self._sizes = (surface.half_thickness_m, catheter_radius_m, margin_m)
        self._probes = ProbeSet(n_tools * PROBES_PER_TOOL)
        self._capsules = CapsuleMemory(n_tools * N_SEGMENTS, max(n_particles - 1, 0))
        self._shapes = ((n_tools, N_SEGMENTS, 2, 3), (n_tools, N_SEGMENTS), (n_particles, 3), (n_tools,))
        self._everyone = np.ones(n_tools, np.bool_)
        self._writer = PairWriter()

    def reset(self) -> None:
        """Forget the past: the next `detect` finds the sides from the positions alone."""
        self._probes.reset()
        self._capsules.reset()

    def detect(
        self,
        segments_m: FloatArray,
        radii_m: FloatArray,
        particle_positions_m: FloatArray,
        pairs_out: ContactPairs,
        present: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Append the pairs of this tick.

        Parameters
        ----------
        segments_m : (n_tools, 3, 2, 3) float64
            Start and end of shaft (port to junction) and jaws (junction to tip).
        radii_m : (n_tools, 3) float64
        particle_positions_m : (n, 3) float64
        pairs_out : ContactPairs
        present : (n_tools,) bool, optional
            An absent tool touches nothing and loses its past.
        """
        who = self._everyone if present is None else present
        shapes = (segments_m.shape, radii_m.shape, particle_positions_m.shape, who.shape)
        if shapes != self._shapes:
            raise ValueError(f"segments, radii, particles and present have shapes {shapes}, not {self._shapes}")
        state = (self._probes.address, self._capsules.address)
        tools = (segments_m, radii_m, who)
        rows = self._writer.open(pairs_out)
        _detect(self.surface.address, state, tools, particle_positions_m, self._sizes, rows)
        self._writer.close()


@kernel
def _detect(
    shell_address: int,
    state: tuple[int, int],
    tools: Tools,
    particles: FloatArray,
    sizes: tuple[float, float, float],
    rows_address: int,
) -> None:
    """Detect everything; ``state`` holds the addresses of probes and capsules."""
    rows = rows_at(rows_address)
    _detect_wall(shell_at(shell_address), probes_at(state[0]), tools, sizes, rows)
    detect_capsules(memory_at(state[1]), tools, particles, sizes, rows)


@kernel
def _detect_wall(shell: Shell, probes: Probes, tools: Tools, sizes: tuple[float, float, float], rows: Rows) -> None:
    probes.early = EARLY_SEARCHES
    half_thickness, _, margin = sizes
    for tool in range(tools[0].shape[0]):
        first = tool * PROBES_PER_TOOL
        for segment in range(N_SEGMENTS):
            count = SHAFT_PROBES if segment == SHAFT else JAW_PROBES
            if tools[2][tool]:
                ends, thickness = segment_ends(tools, tool, segment), tools[1][tool, segment] + half_thickness
                for k in range(count):
                    _advance_piece(shell, probes, first + k, _piece(segment, k, ends), thickness + margin)
                _write_segment(probes, (tool, segment), (first, first + count), ends, (thickness, margin), rows)
            else:
                for k in range(count):
                    forget(probes, first + k)
            first += count


@kernel
def _advance_piece(shell: Shell, probes: Probes, i: int, ends: tuple[Vector, Vector], reach: float) -> None:
    if ends[0] == ends[1]:
        # Beyond the port: this part of the shaft is outside the patient.
        forget(probes, i)
    else:
        advance(shell.body, shell.wall, probes, i, ends, (reach, UNKNOWN), (reach, UNKNOWN))


@kernel
def _piece(segment: int, k: int, ends: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """Return the ends of probe k of a segment; a shaft's are counted from its far end back."""
    p, axis = ends[0], subtract(ends[1], ends[0])
    if segment != SHAFT:
        return (along(p, axis, k / JAW_PROBES), along(p, axis, (k + 1) / JAW_PROBES))
    length = math.sqrt(dot(axis, axis))
    piece = PIECE_M / length if length > 0.0 else 1.0
    start = 0.0 if k == SHAFT_PROBES - 1 else max(1.0 - (k + 1) * piece, 0.0)
    return (along(p, axis, start), along(p, axis, max(1.0 - k * piece, 0.0)))


@kernel
def _write_segment(
    probes: Probes,
    who: tuple[int, int],
    span: tuple[int, int],
    ends: tuple[Vector, Vector],
    sizes: tuple[float, float],
    rows: Rows,
) -> None:
    """Write the contacts of one segment; of two neighbours meeting at one point the deeper stands for both."""
    thickness, margin = sizes
    axis = subtract(ends[1], ends[0])
    length2 = dot(axis, axis)
    for row in range(MINIMA * span[0], MINIMA * span[1]):
        gap, triangle = floats(probes.distance)[row] - thickness, ints(probes.triangle)[row]
        if triangle == NOTHING or not gap < margin or _is_repeated(probes, row, span):
            continue
        s = dot(subtract(_axis_point(probes, row), ends[0]), axis) / length2
        place = floats(probes.place)
        weights = (place[4 * row + 1], place[4 * row + 2], place[4 * row + 3])
        pair = (who[0], who[1], -1, DUCT_TRIANGLE, triangle, clamp01(s), weights)
        write_pair(rows, pair, gap, vector(floats(probes.normal), row))


@kernel
def _axis_point(probes: Probes, row: int) -> Vector:
    i, s = row // MINIMA, floats(probes.place)[4 * row]
    a, b = vector(floats(probes.ends), 2 * i), vector(floats(probes.ends), 2 * i + 1)
    return along(scaled(a, 1.0 - s), b, s)


@kernel
def _is_repeated(probes: Probes, row: int, span: tuple[int, int]) -> bool:
    """Return whether the probe before or after has a deeper contact of the same direction close by."""
    i, mine = row // MINIMA, floats(probes.distance)[row]
    point, normal = _axis_point(probes, row), vector(floats(probes.normal), row)
    for j in (i - 1, i + 1):
        if j < span[0] or j >= span[1]:
            continue
        near2 = 0.25 * min(_length2(probes, i), _length2(probes, j))
        for other in range(MINIMA * j, MINIMA * (j + 1)):
            deeper = floats(probes.distance)[other] - mine
            if ints(probes.triangle)[other] == NOTHING or deeper > 0.0 or (deeper == 0.0 and j > i):
                continue
            is_same_way = dot(normal, vector(floats(probes.normal), other)) > SAME_WAY
            if is_same_way and squared_distance(point, _axis_point(probes, other)) < near2:
                return True
    return False


@kernel
def _length2(probes: Probes, i: int) -> float:
    return squared_distance(vector(floats(probes.ends), 2 * i), vector(floats(probes.ends), 2 * i + 1))
