"""The candidates of a scene: they are measured at the start of a step, chosen for rows, and priced at its end."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.forceps.tool_body import ToolBody
from services.mechanics.bodies.sections import segment_radii
from services.mechanics.collision.candidate_list import CandidateList, list_at, set_wanted_gaps
from services.mechanics.collision.candidates import Candidates, Where, candidates_at
from services.mechanics.collision.capsules import CapsuleMemory, detect_capsules
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.pieces import N_TOOL_PIECES, put_piece, write_pieces
from services.mechanics.collision.placed_wall import place_walls
from services.mechanics.collision.wall_candidates import WallCandidates
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import along, row
from services.mechanics.contact.engagement import engage_tools
from services.mechanics.contact.geometry import ContactGeometry
from services.mechanics.contact.price import (
    update_working_set,
    write_capsule_violations,
    write_chosen,
    write_violations,
)
from services.mechanics.contact.spheres import Spheres, no_spheres
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.system import STRATEGIES, ContactSystem
from services.mechanics.contact.working_set import TOUCHING_M, WorkingSet, choose, merge_distance_m
from services.mechanics.reduction import ReducedDuct
from services.mechanics.scene import SceneModel

Moving = tuple[DuctBody, CatheterBody, ToolBody]

#: Maximum number of closest pairs: a duct that two jaws have pinched shut has 600 within a millimetre.
CAPACITY = 4096


class CandidateSearch:
    """Finds contacts, and pairs that may come into contact, between catheter, spheres, tools and wall."""

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self._radii_m, self._half_m = segment_radii(scene.catheter), 0.5 * scene.duct.thickness_m
        self._margin_m = scene.contact.margin_m
        self._end = N_TOOL_PIECES + len(self._radii_m)
        self._duct = duct
        # Penalty contacts do not share a load, so there is only one per triangle, as in the paper.
        shares_load = STRATEGIES[scene.contact.model].keeps_delassus
        self._wall = WallCandidates(duct, self._end, TOUCHING_M if shares_load else -1.0)
        self._start_wall = place_walls(duct, self._wall.placement)
        # Contacts that are not priced at the end of a step have rows before they touch.
        is_priced = shares_load and scene.catheter.integrator == "implicit"
        self._row_gap_m = TOUCHING_M if is_priced else max(TOUCHING_M, self._margin_m)
        self._found, self._ended = Candidates.zeros(c=CAPACITY), Candidates.zeros(c=CAPACITY)
        self._capsules = CapsuleMemory.zeros(m=N_TOOL_PIECES, n=len(self._radii_m))
        self._spheres, self._catheter_ahead_m = no_spheres(), self._row_gap_m
        self._make_room()

    def _make_room(self) -> None:
        listed, mesh = self._wall.list, self._duct.mesh
        n_pieces = len(listed.count)
        rest, sizes = np.ascontiguousarray(mesh.vertices_m), {"p": n_pieces, "m": len(mesh.triangles), "c": CAPACITY}
        self._working = WorkingSet.zeros(rest=rest, first_sphere=self._end, **sizes)
        self._start: Where = (np.zeros((n_pieces, 2, 3)), self._start_wall.position_m)
        self._ahead_m = np.full(n_pieces, self._row_gap_m)
        self._ahead_m[N_TOOL_PIECES : self._end] = self._catheter_ahead_m
        self._is_unknown = self._apart_is_unknown = True

    def set_spheres(self, spheres: Spheres) -> None:
        """Find contacts of spheres with the wall too; again once there are more of them."""
        self._spheres = spheres
        self._wall.make_room(self._end + spheres.count)
        self._make_room()

    @property
    def has_candidates(self) -> bool:
        """Whether any pair is so near that it may come into contact within a step."""
        return bool(self._wall.list.n_nodes > 0 or self._capsules.active.any())

    @property
    def wall_moved_m(self) -> float:
        """Largest motion in the last step of a node of a candidate, by modes and loads; 0 if nothing was priced."""
        return self._working.wall_moved_m

    def begin(self, bodies: Moving, system: ContactSystem) -> None:
        """Place wall and pieces at the start of a step, and choose the candidates that get rows."""
        duct, catheter, tools = bodies
        listed, n = self._wall.list, duct.n_loads
        self._write_pieces(catheter.start_m, tools)
        if self._spheres.count:
            write_spheres(listed.address, system.address, 0.0, (self._end, self._half_m))
        if self._apart_is_unknown:
            self._working.merge_m[:] = merge_distance_m(listed.thickness, 2.0 * self._half_m)
            self._apart_is_unknown = False
        self._start[0][:] = listed.ends
        if self._is_unknown:
            set_wanted_gaps(listed.address, self._start[0], self._ahead_m)
        if self._wall.follow(duct.q_start, (duct.load_nodes[:n], duct.load_force_n[:n])) or self._is_unknown:
            self._wall.measure(self._found)
        self._is_unknown = True
        choose((listed.address, self._found.address, self._working.address), self._ahead_m, system.geometry.address)
        self._start_wall.follow(self._wall.placement)

    def restore_start(self) -> None:
        """Measure anew at the start of the next step: bodies are where they were at that of the last one."""
        self._is_unknown = True

    def _write_pieces(self, particles_m: FloatArray, tools: ToolBody) -> None:
        poses = (tools.segments, tools.radius_m, tools.present)
        write_pieces(self._wall.list.address, particles_m, poses, (self._radii_m, self._half_m))

    def write_pairs(self, catheter: CatheterBody, tools: ToolBody, pairs: ContactPairs) -> None:
        """Append the chosen candidates of tools, catheter and spheres, and pairs of the tools with the catheter."""
        chosen = self._found.address, self._working.address
        write_chosen(*chosen, (0, N_TOOL_PIECES), pairs.address)
        poses, sizes = (tools.segments, tools.radius_m, tools.present), (self._radii_m, self._margin_m)
        detect_capsules((self._capsules.address, pairs.address), poses, catheter.start_m, sizes)
        write_chosen(*chosen, (N_TOOL_PIECES, len(self._ahead_m)), pairs.address)

    def engage(self, pairs: ContactPairs, geometry: Address[ContactGeometry]) -> None:
        """Engage disengaged tools, unless a candidate or one of ``pairs`` shows that they overlap a body."""
        engage_tools(self._found.address, pairs.address, geometry)

    def price(self, bodies: Moving, state: Address[ContactState], tolerance_m: float, pairs: ContactPairs) -> int:
        """Write pairs of the candidates that end the step too deep, at the present poses; return their number."""
        duct, catheter, tools = bodies
        n = duct.n_loads
        self._write_pieces(catheter.state.position_m, tools)
        if self._spheres.count:
            write_spheres(self._wall.list.address, state, 1.0, (self._end, self._half_m))
        placed = duct.state.q, (duct.load_nodes[:n], duct.load_force_n[:n]), duct.lasting_loads
        self._wall.measure_end(placed, (self._start[0], self._ahead_m, self._found), self._start_wall)
        self._is_unknown = False
        found = self._found.address, self._ended.address
        addresses = (self._wall.list.address, found, self._working.address, state)
        return int(write_violations(addresses, self._start, tolerance_m, pairs.address))

    def price_tools(self, state: Address[ContactState], tolerance_m: float, pairs: ContactPairs) -> int:
        """Append pairs of tools and catheter that end too deep, at the poses of the last `price`; return how many."""
        addresses, sizes = (self._wall.list.address, self._capsules.address, state), (self._half_m, tolerance_m)
        return int(write_capsule_violations(addresses, self._start[0], sizes, pairs.address))

    def update_working_set(self, state: Address[ContactState]) -> None:
        """Age the working set by a step, and renew the features whose contacts carried a force in it."""
        update_working_set(state, self._working.address)

    def set_catheter_row_gap(self, gap_m: float) -> None:
        """Give the catheter rows from this gap (m) on, for laws that act across a gap."""
        self._catheter_ahead_m = max(gap_m, self._row_gap_m)
        self._wall.is_new = True
        self._make_room()

    def forget(self) -> None:
        """Clear the working set, because bodies have been put elsewhere."""
        self._working.life[:], self._working.n_members = 0, 0
        self._capsules.reset()
        self._wall.is_new = True
        self._is_unknown = True

    @property
    def dropped(self) -> int:
        """Candidates and entries of lists that exceeded their capacity since the start."""
        return int(self._wall.list.dropped + self._found.dropped + self._ended.dropped)

    def is_sound(self) -> bool:
        """Return whether the catheter's axis was clear of the wall's middle surface when the step began."""
        return not pierces(self._found.address, self._wall.list.address, self._end)


@kernel
def pierces(found_address: Address[Candidates], list_address: Address[CandidateList], end: int) -> bool:
    """Return whether the axis of a piece of the catheter, before ``end``, goes through a triangle."""
    found, listed = candidates_at(found_address), list_at(list_address)
    for i in range(found.count):
        p = found.piece[i]
        if N_TOOL_PIECES <= p < end and found.gap_m[i] <= -listed.thickness[p]:
            return True
    return False


@kernel
def write_spheres(
    list_address: Address[CandidateList], state_address: Address[ContactState], share: float, pieces: tuple[int, float]
) -> None:
    """Write spheres into a list: where the step starts (``share`` 0) or ends (1).

    ``pieces`` is (number of the first one, half the thickness of the wall in m).
    """
    listed, state = list_at(list_address), state_at(state_address)
    spheres, rows = state.geometry.spheres, state.rows
    for k in range(spheres.count):
        place = along(row(spheres.start, k), row(spheres.motion, k), share)
        for at in range(rows.n_contacts):
            if rows.stone[at] == k:
                place = along(place, row(state.force_n, at), share * spheres.compliance[k])
        put_piece(listed, pieces[0] + k, (place, place), spheres.radius[k] + pieces[1])
