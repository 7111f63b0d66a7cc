"""The pieces of a scene, as candidate lists number them: the segments of the tools, then those of the catheter."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.candidate_list import CandidateList
from trocar.services.mechanics.collision.capsules import Segment, Tools, ends_of
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, write_pair
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, put_row_of, row
from trocar.services.mechanics.scene.tools import N_TOOLS

#: Pieces of tools come first: three of each, as it has a shaft and two jaws.
N_TOOL_PIECES = 3 * N_TOOLS


@kernel
def write_pieces(listed: CandidateList, particles: FloatArray, tools: Tools, sizes: tuple[FloatArray, float]) -> None:
    """Write the ends of all pieces, and which of them are active; without particles (0, 3) there is no catheter.

    ``sizes`` is (radii of the catheter's segments, half the thickness of the wall), in m.
    """
    segments, radius, present = tools
    n_segments = segments.shape[1]
    first = segments.shape[0] * n_segments
    for p in range(first):
        tool, segment = p // n_segments, p % n_segments
        put_piece(listed, p, ends_of(segments[tool], segment), radius[tool, segment] + sizes[1])
        listed.active[p] = present[tool] and radius[tool, segment] > 0.0
    for k in range(particles.shape[0] - 1):
        put_piece(listed, first + k, (row(particles, k), row(particles, k + 1)), sizes[0][k] + sizes[1])


@kernel
def put_piece(listed: CandidateList, p: int, ends: Segment, thickness: float) -> None:
    """Write a piece as active, with its axis between two points and its distance (m) from the wall in contact."""
    listed.active[p], listed.thickness[p] = True, thickness
    put_row_of(listed.ends, p, 0, ends[0])
    put_row_of(listed.ends, p, 1, ends[1])


@kernel
def owner_of(p: int) -> tuple[int, int, int]:
    """Return tool, segment and particle of a piece, as pairs have them."""
    return (p // 3, p % 3, -1) if p < N_TOOL_PIECES else (NO_TOOL, 0, p - N_TOOL_PIECES)


@kernel
def write_piece_pair(
    pairs: ContactPairs, place: tuple[int, int], s: float, w: Vector, gap_m: float, normal: Vector
) -> None:
    """Write the contact pair of a piece and a triangle; ``place`` is (piece, triangle)."""
    tool, segment, particle = owner_of(place[0])
    write_pair(pairs, (tool, segment, particle, DUCT_TRIANGLE, place[1], s, w), gap_m, normal)
