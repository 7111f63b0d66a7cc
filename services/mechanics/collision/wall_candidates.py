"""Candidates between pieces of bodies and a wall, with lists that persist from tick to tick, for physics and haptics.

A tick calls `follow` after it has written the pieces' positions, and then `measure` as often as necessary.
"""

from __future__ import annotations

from copy import copy

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.candidate_list import (
    RENEWED,
    SAME,
    WALL_MOVED_TOO_FAR,
    CandidateList,
    add_travel,
    largest_bound,
    list_at,
    new_list,
    renew_lists,
    set_wanted_gaps,
)
from services.mechanics.collision.candidates import Candidates, candidates_at, measure
from services.mechanics.collision.clusters import Clusters, cluster_triangles, enclose
from services.mechanics.collision.placed_wall import (
    Loads,
    PlacedWall,
    WallPlacement,
    place_walls,
    request_node,
    wall_at,
)
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.reduction.reduced_duct import ReducedDuct

#: A list is complete until piece and wall have moved by this. A thicker skin means longer lists, a thinner one more
#: frequent rebuilds.
SKIN_M = 0.5e-3
#: Motion of the wall by this fraction of the skin rebuilds all lists; the rest of the skin is for the pieces' motion.
WALL_SHARE = 0.5

EndSearch = tuple[FloatArray, FloatArray, Candidates]
"""Ends of the pieces at the start of the step, gaps as for `set_wanted_gaps`, and room for the candidates."""


class WallCandidates:
    """Candidate lists of ``n_pieces`` pieces and the wall of a duct; ``along_m`` is that of `CandidateList`.

    Attributes:
        list: CandidateList. The caller writes its ``ends``, ``thickness``, ``active``, ``wanted`` and ``reach`` before
            `follow`.
        placement: WallPlacement. The wall's present configuration.
        is_new: bool. Whether the next `follow` rebuilds all lists.
        renewals, wall_renewals: int. Number of rebuilds of single pieces' lists, and of all lists because of the wall.
    """

    def __init__(self, duct: ReducedDuct, n_pieces: int, along_m: float) -> None:
        self.placement = place_walls(duct)
        self._bounds = copy(self.placement.bounds)
        self._clusters = cluster_triangles(duct.mesh.vertices_m, duct.mesh.triangles)
        self._along_m, self.renewals, self.wall_renewals = along_m, 0, 0
        self.make_room(n_pieces)

    def make_room(self, n_pieces: int) -> None:
        """Allocate lists for ``n_pieces``; the next `follow` rebuilds them."""
        self.list = new_list(self._clusters, self.placement.position_m, n_pieces, SKIN_M, self._along_m)
        self.is_new = True

    def follow(self, q: FloatArray, loads: Loads) -> bool:
        """Set the wall's coordinates q (r,) and loads, and rebuild the lists of pieces that have moved too far.

        Return whether anything has changed since `measure_end`; if not, the candidates measured there are still valid.
        """
        listed, modes_moved_m = self.list, self._bounds.moved_m(q)
        if self.is_new or modes_moved_m > WALL_SHARE * SKIN_M:
            self._renew_wall(q, loads)
            return True
        is_elsewhere = add_travel(listed.address, self.placement.set_configuration(q, loads))
        if is_elsewhere:
            self._place()
        outcome = renew_lists(listed.address, modes_moved_m, WALL_SHARE * SKIN_M)
        if outcome == WALL_MOVED_TOO_FAR:
            self._renew_wall(q, loads)
        elif outcome == RENEWED:
            self.renewals += 1
        return is_elsewhere or outcome != SAME

    def measure_end(self, placed: tuple[FloatArray, Loads, Loads], search: EndSearch, start: WallPlacement) -> None:
        """Measure at the end of a step, and place the nodes of what is found in the configuration of ``start``.

        ``placed`` is (coordinates, loads, lasting loads) of the wall there. Travel grows; lists are not rebuilt.
        """
        moved_m, addresses = self.placement.set_configuration(*placed), (self.list.address, self.placement.wall.address)
        request_end(addresses, moved_m, search[0], search[1])
        self.placement.place_requested()
        measure_end(self.list.address, search[2].address, start.wall.address)
        start.place_requested()

    def measure(self, out: Candidates) -> None:
        """Write the closest pairs with a gap up to ``wanted``."""
        self._place()
        measure(self.list.address, out.address)

    def _place(self) -> None:
        """Place the nodes of entries whose gap may be at most ``wanted``."""
        request_nodes_of_entries(self.list.address, self.placement.wall.address)
        self.placement.place_requested()

    def _renew_wall(self, q: FloatArray, loads: Loads) -> None:
        """Rebuild all lists from the present positions of all nodes."""
        listed = self.list
        self.placement.set_configuration(q, loads)
        self.placement.place(self.placement.every)
        listed.listed_position[:] = listed.position
        self._bounds.set_reference(q)
        enclose(listed.clusters.address, listed.position)
        listed.is_listed[:], listed.wall_travel, listed.piece_travel[:] = False, 0.0, 0.0
        listed.last_ends[:] = listed.ends
        self.is_new = False
        renew_lists(listed.address, 0.0, 0.0)
        self.wall_renewals += 1


@kernel
def request_nodes_of_entries(list_address: Address[CandidateList], wall_address: Address[PlacedWall]) -> None:
    """Request the nodes of entries whose gap may be at most ``wanted``."""
    listed, wall = list_at(list_address), wall_at(wall_address)
    for p in range(listed.count.shape[0]):
        most = largest_bound(listed, p)
        for k in range(listed.count[p]):
            if listed.bound[p, k] <= most:
                _request_nodes_of_triangle(wall, listed.clusters, listed.entry[p, k])


@kernel
def request_end(
    addresses: tuple[Address[CandidateList], Address[PlacedWall]], moved_m: float, start: FloatArray, ahead: FloatArray
) -> None:
    """Add the travel to the end of a step, and request the nodes of entries that may be candidates there."""
    add_travel(addresses[0], moved_m)
    set_wanted_gaps(addresses[0], start, ahead)
    request_nodes_of_entries(addresses[0], addresses[1])


@kernel
def measure_end(
    list_address: Address[CandidateList], found_address: Address[Candidates], wall_address: Address[PlacedWall]
) -> None:
    """Write the closest pairs with a gap up to ``wanted``, and request their nodes of another wall."""
    measure(list_address, found_address)
    found, clusters, wall = candidates_at(found_address), list_at(list_address).clusters, wall_at(wall_address)
    for i in range(found.count):
        _request_nodes_of_triangle(wall, clusters, found.triangle[i])


@kernel
def _request_nodes_of_triangle(wall: PlacedWall, clusters: Clusters, t: int) -> None:
    for c in range(3):
        request_node(wall, clusters.triangles[t, c])
