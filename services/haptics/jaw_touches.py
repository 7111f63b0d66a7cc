"""Contacts of closing jaws, which grasps depend on. Physics detects its own contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.services.haptics.deformed_scene import DeformedScene
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.grasp import GRASP_GAP_M
from trocar.services.mechanics.bodies.sections import segment_radii
from trocar.services.mechanics.collision.candidate_list import MAX_ENTRIES, TOUCHING_M
from trocar.services.mechanics.collision.candidates import Candidates, candidates_at
from trocar.services.mechanics.collision.capsules import CapsuleMemory, Tools, capsules_at, detect_capsules
from trocar.services.mechanics.collision.pairs import SHAFT, ContactPairs, pairs_at
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES, write_piece_pair, write_pieces
from trocar.services.mechanics.collision.placed_wall import Loads
from trocar.services.mechanics.collision.wall_candidates import (
    WallCandidates,
    candidates_of,
    follow_wall,
    measure,
    wall_candidates,
)
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import row
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import N_TOOLS

#: Slightly above a grasp's gap, so that rounding of bounds does not hide a contact at just that gap.
_LOOK_M = 1.1 * GRASP_GAP_M


class JawTouches:
    """Detects contacts of jaws with wall and catheter.

    Args:
        radius_m: (2, 3). Radii of the tools' segments, zero for absent ones.

    Attributes:
        pairs: ContactPairs. Of each jaw the closest pair with the wall, and the pairs with the catheter's segments.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct, radius_m: FloatArray) -> None:
        self._sizes_m = segment_radii(scene.catheter), 0.5 * scene.duct.thickness_m
        self._jaw_radius_m = radius_m.copy()
        self._jaw_radius_m[:, SHAFT] = 0.0
        n_segments = len(self._sizes_m[0])
        self._looks = np.zeros(N_TOOLS, np.bool_)
        self._wall = wall_candidates(duct, N_TOOL_PIECES, TOUCHING_M)
        self._wall.list.wanted[:] = self._wall.list.reach[:] = _LOOK_M
        self._found = Candidates.zeros(c=2 * N_TOOLS * MAX_ENTRIES)
        self._capsules = CapsuleMemory.zeros(m=N_TOOL_PIECES, n=n_segments)
        self.pairs = ContactPairs.zeros(capacity=2 * N_TOOLS * (1 + n_segments))

    def find(self, tools: Sequence[int], segments_m: FloatArray, scene: DeformedScene) -> None:
        """Write the contacts of the jaws of ``tools``, with segments (2, 3, 2, 3), into `pairs`."""
        self.pairs.clear()
        if not (tools and scene.has_catheter):
            return
        self._looks[:] = False
        self._looks[list(tools)] = True
        jaws = segments_m, self._jaw_radius_m, self._looks
        self._capsules.reset()
        measure_jaws((self._wall.address, self._found.address), jaws, self._sizes_m, scene.q, scene.loads)
        addresses = self._found.address, self._capsules.address
        write_jaw_pairs(addresses, jaws, scene.particles_m, self._sizes_m[0], self.pairs.address)

    def forget(self) -> None:
        """Rebuild all lists in the next call, as the scene restarts."""
        self.pairs.clear()
        self._wall.is_new = True

    @property
    def dropped(self) -> int:
        """Number of triangles near a jaw lost for lack of capacity since the start."""
        return int(self._wall.list.dropped)


@kernel
def measure_jaws(
    addresses: tuple[Address[WallCandidates], Address[Candidates]],
    jaws: Tools,
    sizes: tuple[FloatArray, float],
    q: FloatArray,
    loads: Loads,
) -> None:
    """Write the closest pairs of the jaws with a wall of coordinates q (r,); ``sizes`` are those of `write_pieces`."""
    known = candidates_of(addresses[0])
    write_pieces(known.list, jaws[0][0, 0, :0], jaws, sizes)
    follow_wall(known, q, loads)
    measure(known, candidates_at(addresses[1]))


@kernel
def write_jaw_pairs(
    addresses: tuple[Address[Candidates], Address[CapsuleMemory]],
    jaws: Tools,
    particles: FloatArray,
    radii_m: FloatArray,
    pairs_address: Address[ContactPairs],
) -> None:
    """Write the closest pair of each jaw with the wall, and those with a catheter of these segment radii.

    Distances from the catheter are unsigned after a reset of the memory.
    """
    found, pairs = candidates_at(addresses[0]), pairs_at(pairs_address)
    for piece in range(N_TOOL_PIECES):
        i = _closest(found, piece)
        if i >= 0 and found.gap_m[i] < GRASP_GAP_M:
            place = piece, found.triangle[i]
            write_piece_pair(pairs, place, found.s[i], row(found.weight, i), found.gap_m[i], row(found.normal, i))
    detect_capsules(capsules_at(addresses[1]), pairs, jaws, particles, (radii_m, GRASP_GAP_M))


@inlined_kernel
def _closest(found: Candidates, piece: int) -> int:
    """Return the closest candidate of a piece, -1 if there is none."""
    best = -1
    for i in range(found.count):
        if found.piece[i] == piece and (best < 0 or found.gap_m[i] < found.gap_m[best]):
            best = i
    return best
