"""Candidates between pieces of bodies and a wall, kept from tick to tick; one for physics and for haptics.

A tick calls `follow` once pieces are where they are, then `measure` as often as it wants.
"""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.candidate_list import (
    RENEWED,
    SAME,
    WALL_IS_DUE,
    CandidateList,
    are_where_they_were,
    list_at,
    new_list,
    note_motion,
    renew_lists,
)
from services.mechanics.collision.candidates import Candidates, measure
from services.mechanics.collision.clusters import cluster_triangles, enclose
from services.mechanics.collision.placed_wall import NO_LOADS, Loads, place_walls
from services.mechanics.collision.wall_bounds import wall_bounds
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.reduction.reduced_duct import ReducedDuct

#: A list is complete until piece and wall have moved by this: thicker lists are longer, thinner ones renewed sooner.
SKIN_M = 0.5e-3
#: The wall lists everything anew at half of it, and leaves the other half to the pieces.
WALL_SHARE = 0.5


class WallCandidates:
    """Lists of so many pieces against the wall of a duct; ``along_m`` as `CandidateList` has it.

    Attributes
    ----------
    list : CandidateList
        Whose ``ends``, ``thickness``, ``active``, ``wanted`` and ``reach`` the caller writes before `follow`.
    is_new : bool
        Whether all lists are made anew in the next `follow`.
    renewals, wall_renewals : int
        How often pieces, and all of them because of the wall, were listed anew.
    """

    def __init__(self, duct: ReducedDuct, n_pieces: int, along_m: float) -> None:
        self._placement, self._bounds = place_walls(duct), wall_bounds(duct)
        self._clusters = cluster_triangles(duct.mesh.vertices_m, duct.mesh.triangles)
        self._along_m = along_m
        self.list = new_list(self._clusters, self._placement.position_m, n_pieces, SKIN_M, along_m)
        self._nodes: IntArray = np.zeros(0, np.int32)
        self.is_new = True
        self.renewals = self.wall_renewals = 0

    @property
    def position_m(self) -> FloatArray:
        """(n, 3) where nodes of the wall are; those of listed triangles as of the last `follow` or `move`."""
        return self._placement.position_m

    def make_room(self, n_pieces: int) -> None:
        """Make room for so many pieces; all lists are made anew."""
        self.list = new_list(self._clusters, self._placement.position_m, n_pieces, SKIN_M, self._along_m)
        self.is_new = True

    def forget(self) -> None:
        """Make all lists anew in the next `follow`: bodies have been put elsewhere."""
        self.is_new = True

    def follow(self, q: FloatArray, loads: Loads) -> bool:
        """Place the wall by coordinates q (r,) and loads, and renew the lists of what has moved too far.

        Return whether anything is other than at the last `move`: what was measured there still holds if not.
        """
        listed, modes_moved_m = self.list, self._bounds.moved_m(q)
        if self.is_new or modes_moved_m > WALL_SHARE * SKIN_M:
            self._renew_wall(q, loads)
            return True
        is_elsewhere = not (are_where_they_were(listed.address) and self._placement.is_placed_by(q, loads))
        if is_elsewhere:
            self.move(q, loads)
        outcome = renew_lists(listed.address, modes_moved_m, WALL_SHARE * SKIN_M)
        if outcome == WALL_IS_DUE:
            self._renew_wall(q, loads)
        elif outcome == RENEWED:
            self.renewals += 1
            self._nodes = listed.node[: listed.n_nodes]
            self._placement.place(self._nodes, q, loads)
        return is_elsewhere or outcome != SAME

    def move(self, q: FloatArray, loads: Loads, lasting: Loads = NO_LOADS) -> None:
        """Place the listed nodes, and count how far they and the pieces have come: the lists stay."""
        note_motion(self.list.address, self._placement.place(self._nodes, q, loads, lasting))

    def measure(self, out: Candidates, first: int = 0, end: int | None = None) -> None:
        """Write the closest pairs of pieces from ``first`` to before ``end`` that are as near as is wanted of each."""
        measure(self.list.address, out.address, (first, len(self.list.count) if end is None else end))

    def _renew_wall(self, q: FloatArray, loads: Loads) -> None:
        """List everything anew, from where all nodes are now."""
        listed = self.list
        self._placement.place(self._placement.every, q, loads)
        listed.listed_position[:] = listed.position
        self._bounds.take(q)
        enclose_at(listed.address)
        listed.is_listed[:] = False
        listed.last_ends[:] = listed.ends
        self.is_new = False
        renew_lists(listed.address, 0.0, 0.0)
        self._nodes = listed.node[: listed.n_nodes]
        self.wall_renewals += 1


@kernel
def enclose_at(address: Address[CandidateList]) -> None:
    """Put spheres round the triangles of a list where the nodes are."""
    listed = list_at(address)
    enclose(listed.clusters, listed.position)
