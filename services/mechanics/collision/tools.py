"""Contacts of the forceps' shafts and jaws with the wall of the duct and with the catheter."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.capsules import CapsulePairs, detect_capsules, make_capsule_pairs
from services.mechanics.collision.kernel import kernel
from services.mechanics.collision.primitives import Vector, along, scaled, squared_distance, subtract
from services.mechanics.collision.probes import (
    EARLY_SEARCHES,
    MINIMA,
    Probes,
    advance,
    end_of,
    forget,
    make_probes,
)
from services.mechanics.collision.search import APART, NOTHING
from services.mechanics.collision.sides import UNKNOWN
from services.mechanics.collision.surface import DuctSurface, Shell
from services.mechanics.collision.writer import FULL, PairRows, PairWriter, take_row
from services.mechanics.contact.pairs import DUCT_TRIANGLE, SHAFT, ContactPairs
from services.mechanics.mesh import FloatArray

N_SEGMENTS = 3
# Probes per segment. The shaft's are of PIECE_M, counted from the junction, the last reaching to the port: they
# stay where they are in the instrument while it slides through the port. A jaw's share the jaw.
SHAFT_PROBES, JAW_PROBES = 9, 5
PROBES_PER_TOOL = SHAFT_PROBES + 2 * JAW_PROBES
PIECE_M = 5e-3


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
        self._probes = make_probes(n_tools * PROBES_PER_TOOL)
        self._capsules = make_capsule_pairs(n_tools * N_SEGMENTS, max(n_particles - 1, 0))
        self._everyone = np.ones(n_tools, np.bool_)
        self._writer = PairWriter()

    def reset(self) -> None:
        """Forget the past: the next `detect` finds the sides from the positions alone."""
        self._probes.slack.fill(-1.0)
        self._capsules.active.fill(0)

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
        rows = self._writer.open(pairs_out)
        _detect_wall(self.surface.shell, self._probes, (segments_m, radii_m, who), self._sizes, rows)
        detect_capsules(self._capsules, (segments_m, radii_m, who), particle_positions_m, self._sizes, rows)
        self._writer.close()


Tools = tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]


@kernel
def _detect_wall(shell: Shell, probes: Probes, tools: Tools, sizes: tuple[float, float, float], rows: PairRows) -> None:
    segments, radii, present = tools
    probes.early[0] = EARLY_SEARCHES
    for tool in range(segments.shape[0]):
        first = tool * PROBES_PER_TOOL
        for segment in range(N_SEGMENTS):
            count = SHAFT_PROBES if segment == SHAFT else JAW_PROBES
            if present[tool]:
                p, q = end_of(segments[tool], segment, 0), end_of(segments[tool], segment, 1)
                thickness = radii[tool, segment] + sizes[0]
                for k in range(count):
                    a, b = _piece(segment, k, p, q)
                    if a == b:
                        forget(probes, first + k)
                        continue
                    advance(shell.body, shell.wall, probes, first + k, a, b, thickness + sizes[2], UNKNOWN)
                _write_segment(probes, (tool, segment), (first, count), (p, q), (thickness, sizes[2]), rows)
            else:
                for k in range(count):
                    forget(probes, first + k)
            first += count


@kernel
def _piece(segment: int, k: int, p: Vector, q: Vector) -> tuple[Vector, Vector]:
    """Return the ends of probe k of a segment pq; a shaft is counted from q back."""
    axis = subtract(q, p)
    if segment != SHAFT:
        return (along(p, axis, k / JAW_PROBES), along(p, axis, (k + 1) / JAW_PROBES))
    length = math.sqrt(squared_distance(p, q))
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
    rows: PairRows,
) -> None:
    """Write the contacts of one segment; of two neighbours meeting at one point the deeper stands for both."""
    thickness, margin = sizes
    axis = subtract(ends[1], ends[0])
    length2 = squared_distance(ends[0], ends[1])
    for i in range(span[0], span[0] + span[1]):
        for k in range(MINIMA):
            gap = probes.distance[i, k] - thickness
            if probes.triangle[i, k] == NOTHING or not gap < margin or _is_repeated(probes, i, k, span):
                continue
            row = take_row(rows, gap, (probes.normal[i, k, 0], probes.normal[i, k, 1], probes.normal[i, k, 2]))
            if row == FULL:
                continue
            here = subtract(_axis_point(probes, i, k), ends[0])
            rows.tool[row], rows.tool_segment[row] = who
            rows.particle[row] = -1
            rows.target_kind[row] = DUCT_TRIANGLE
            rows.target[row] = probes.triangle[i, k]
            s = (here[0] * axis[0] + here[1] * axis[1] + here[2] * axis[2]) / length2 if length2 > 0.0 else 0.0
            rows.tool_parameter[row] = min(max(s, 0.0), 1.0)
            for corner in range(3):
                rows.target_weights[row, corner] = probes.place[i, k, 1 + corner]


@kernel
def _axis_point(probes: Probes, i: int, k: int) -> Vector:
    a, b = end_of(probes.ends, i, 0), end_of(probes.ends, i, 1)
    return along(scaled(a, 1.0 - probes.place[i, k, 0]), b, probes.place[i, k, 0])


@kernel
def _is_repeated(probes: Probes, i: int, k: int, span: tuple[int, int]) -> bool:
    """Return whether the probe before or after has a deeper contact of the same direction close by."""
    mine, point = probes.distance[i, k], _axis_point(probes, i, k)
    for j in (i - 1, i + 1):
        if j < span[0] or j >= span[0] + span[1]:
            continue
        near2 = 0.25 * min(_length2(probes, i), _length2(probes, j))
        for m in range(MINIMA):
            other = probes.distance[j, m]
            if probes.triangle[j, m] == NOTHING or other > mine or (other == mine and j > i):
                continue
            facing = 0.0
            for axis in range(3):
                facing += probes.normal[i, k, axis] * probes.normal[j, m, axis]
            if facing > APART and squared_distance(point, _axis_point(probes, j, m)) < near2:
                return True
    return False


@kernel
def _length2(probes: Probes, i: int) -> float:
    return squared_distance(end_of(probes.ends, i, 0), end_of(probes.ends, i, 1))
