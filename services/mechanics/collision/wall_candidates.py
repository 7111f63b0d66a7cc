"""Candidates between pieces of bodies and a wall, kept from tick to tick; one for physics and for haptics.

A tick calls `follow` once pieces are where they are, then `measure` as often as it wants.
"""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.candidate_list import (
    RENEWED,
    SAME,
    WALL_IS_DUE,
    CandidateList,
    are_where_they_were,
    list_at,
    may_be_within,
    new_list,
    note_motion,
    renew_lists,
)
from services.mechanics.collision.candidates import Candidates, candidates_at, measure
from services.mechanics.collision.clusters import Clusters, cluster_triangles, enclose
from services.mechanics.collision.placed_wall import (
    NO_LOADS,
    Loads,
    PlacedWall,
    WallPlacement,
    ask_for,
    place_walls,
    wall_at,
)
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.reduction.reduced_duct import ReducedDuct

#: A list is complete until piece and wall have moved by this: thicker lists are longer, thinner ones renewed sooner.
SKIN_M = 0.5e-3
#: The wall lists everything anew at half of it, and leaves the other half to the pieces.
WALL_SHARE = 0.5


class WallCandidates:
    """Lists of so many pieces against the wall of a duct; ``along_m`` as `CandidateList` has it.

    Attributes:
        list: CandidateList. Whose ``ends``, ``thickness``, ``active``, ``wanted`` and ``reach`` the caller writes
            before `follow`.
        is_new: bool. Whether all lists are made anew in the next `follow`.
        renewals, wall_renewals: int. How often pieces, and all of them because of the wall, were listed anew.
    """

    def __init__(self, duct: ReducedDuct, n_pieces: int, along_m: float) -> None:
        self._duct, self._placement = duct, place_walls(duct)
        self._bounds = self._placement.bounds.twin()
        self._clusters = cluster_triangles(duct.mesh.vertices_m, duct.mesh.triangles)
        self._along_m = along_m
        self.list = new_list(self._clusters, self._placement.position_m, n_pieces, SKIN_M, along_m)
        self.is_new = True
        self.renewals = self.wall_renewals = 0

    def new_start(self) -> WallPlacement:
        """Return a placement for where the wall was, see `note_start`."""
        return place_walls(self._duct, self._placement)

    def note_start(self, start: WallPlacement) -> None:
        """Let ``start`` stand where the wall stands."""
        start.follow(self._placement)

    def place_start(self, start: WallPlacement, of: Candidates) -> None:
        """Place the nodes of some candidates where ``start`` stands."""
        ask_of_candidates(of.address, self.list.address, start.wall.address)
        start.place_asked()

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
        moved_m = self._placement.stand(q, loads)
        is_elsewhere = moved_m != 0.0 or not are_where_they_were(listed.address)
        if is_elsewhere:
            note_motion(listed.address, moved_m)
            self._place()
        outcome = renew_lists(listed.address, modes_moved_m, WALL_SHARE * SKIN_M)
        if outcome == WALL_IS_DUE:
            self._renew_wall(q, loads)
        elif outcome == RENEWED:
            self.renewals += 1
        return is_elsewhere or outcome != SAME

    def move(self, q: FloatArray, loads: Loads, lasting: Loads = NO_LOADS) -> None:
        """Let the wall stand elsewhere, and count how far it and the pieces have come: the lists stay."""
        note_motion(self.list.address, self._placement.stand(q, loads, lasting))

    def measure(self, out: Candidates, first: int = 0, end: int | None = None) -> None:
        """Write the closest pairs of pieces from ``first`` to before ``end`` that are as near as is wanted of each."""
        self._place()
        measure(self.list.address, out.address, (first, len(self.list.count) if end is None else end))

    def _place(self) -> None:
        """Place the nodes of entries that may be as near as is wanted."""
        placement = self._placement
        ask_of_entries(self.list.address, placement.wall.address)
        placement.place_asked()

    def _renew_wall(self, q: FloatArray, loads: Loads) -> None:
        """List everything anew, from where all nodes are now."""
        listed = self.list
        self._placement.stand(q, loads)
        self._placement.place(self._placement.every)
        listed.listed_position[:] = listed.position
        self._bounds.take(q)
        enclose_at(listed.address)
        listed.is_listed[:], listed.wall_travel, listed.piece_travel[:] = False, 0.0, 0.0
        listed.last_ends[:] = listed.ends
        self.is_new = False
        renew_lists(listed.address, 0.0, 0.0)
        self.wall_renewals += 1


@kernel
def enclose_at(address: Address[CandidateList]) -> None:
    """Put spheres round the triangles of a list where the nodes are."""
    listed = list_at(address)
    enclose(listed.clusters, listed.position)


@kernel
def ask_of_entries(list_address: Address[CandidateList], wall_address: Address[PlacedWall]) -> None:
    """Ask for the nodes of entries that may be as near as is wanted."""
    listed, wall = list_at(list_address), wall_at(wall_address)
    for p in range(listed.count.shape[0]):
        for k in range(listed.count[p]):
            if may_be_within(listed, p, k):
                _ask_of_triangle(wall, listed.clusters, listed.entry[p, k])


@kernel
def ask_of_candidates(
    found_address: Address[Candidates], list_address: Address[CandidateList], wall_address: Address[PlacedWall]
) -> None:
    """Ask for the nodes of candidates."""
    found, clusters, wall = candidates_at(found_address), list_at(list_address).clusters, wall_at(wall_address)
    for i in range(found.count):
        _ask_of_triangle(wall, clusters, found.triangle[i])


@kernel
def _ask_of_triangle(wall: PlacedWall, clusters: Clusters, t: int) -> None:
    for c in range(3):
        ask_for(wall, clusters.triangles[t, c])
