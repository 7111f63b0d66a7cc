"""The candidates of a scene: they are measured at the start of a step, chosen for rows, and priced at its end."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from trocar.services.mechanics.bodies.forceps.tool_body import ToolPoses, move_back, move_to_proxies
from trocar.services.mechanics.bodies.sections import segment_radii
from trocar.services.mechanics.collision.candidate_list import (
    LOOK_AHEAD_M,
    TOUCHING_M,
    CandidateList,
    copy_ends,
    set_wanted_gaps,
)
from trocar.services.mechanics.collision.candidates import Candidates
from trocar.services.mechanics.collision.capsules import CapsuleMemory, detect_capsules
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, ContactPairs, pairs_at
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES, put_piece, write_pieces
from trocar.services.mechanics.collision.placed_wall import (
    Loads,
    PlacedWall,
    copy_configuration,
    place_requested,
    place_wall,
)
from trocar.services.mechanics.collision.strands import detect_spheres, detect_strands
from trocar.services.mechanics.collision.wall_candidates import (
    WallCandidates,
    follow_end,
    follow_wall,
    measure,
    request_triangle,
    wall_candidates,
)
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import along, row
from trocar.services.mechanics.contact.engagement import engage_tools
from trocar.services.mechanics.contact.identity import TARGET, TARGET_KIND, part_of
from trocar.services.mechanics.contact.laws import HAS_GAP
from trocar.services.mechanics.contact.layers import BesideJaws, count_layers
from trocar.services.mechanics.contact.price import (
    piece_of,
    write_capsule_violations,
    write_chosen,
    write_depths,
    write_violations,
)
from trocar.services.mechanics.contact.rolling import follow_rolling
from trocar.services.mechanics.contact.spheres import Spheres
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.system import STRATEGIES, ContactSystem
from trocar.services.mechanics.contact.working_set import IMPLIED_M, WorkingSet, age_members, choose, renew_member
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import N_TOOLS

LayersOut = tuple[FloatArray, FloatArray]
PIECES_OF_TRIANGLE, LEAST_PAIRS = 4, 4096
"""Room for closest pairs: so many for each of the wall's triangles, and not fewer than on a coarse wall, of which each
triangle is long beside a segment. Where a catheter fills the lumen, a triangle is within a millimetre of the segment
before it, of those beside that, and of a tool: 2.5 was the most in 60 drawn scenes."""


class SearchArrays(Struct):
    """What the search of a scene with p pieces keeps from the start of a step to its end, and from step to step."""

    known: WallCandidates
    start_wall: PlacedWall
    start: Annotated[FloatArray, "p", 2, 3]  # ends of the pieces at the start
    ahead: Annotated[FloatArray, "p"]  # gap (m) up to which a piece gets rows even if nothing moves
    found: Candidates
    violations: Candidates
    working: WorkingSet
    capsules: CapsuleMemory
    beside: BesideJaws
    tools_at_start: ToolPoses
    margin_m: float  # gap up to which tools and catheter get rows
    is_measured: bool = False  # whether the candidates are those of the next start, if nothing moves until then


search_at = reader(SearchArrays)


class CandidateSearch:
    """Finds contacts, and pairs that may come into contact, between catheter, spheres, tools and wall."""

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        n_segments, margin_m = len(segment_radii(scene.catheter)), scene.contact.margin_m
        self._duct, self._end, self._margin_m = duct, N_TOOL_PIECES + n_segments, margin_m
        # Penalty contacts do not share a load, so there is only one per triangle, as in the paper.
        shares_load = STRATEGIES[scene.contact.model].keeps_delassus
        self._along_m = TOUCHING_M if shares_load else -1.0
        # Contacts that are not priced at the end of a step have rows before they touch.
        is_priced = shares_load and scene.catheter.integrator == "implicit"
        self._row_gap_m = self._catheter_ahead_m = IMPLIED_M if is_priced else max(margin_m - TOUCHING_M, 0.0)
        self._n_apart = 0
        self._make_room(wall_candidates(duct, self._end, self._along_m))

    def _make_room(self, known: WallCandidates) -> None:
        mesh, n_pieces = self._duct.mesh, len(known.list.count)
        ahead_m = np.full(n_pieces, self._row_gap_m)
        ahead_m[N_TOOL_PIECES : self._end] = self._catheter_ahead_m
        n_pairs = max(PIECES_OF_TRIANGLE * len(mesh.triangles), LEAST_PAIRS)
        rest, sizes = np.ascontiguousarray(mesh.vertices_m), {"p": n_pieces, "m": len(mesh.triangles), "c": n_pairs}
        self._arrays: SearchArrays = SearchArrays.zeros(
            known=known,
            start_wall=place_wall(self._duct, known.wall),
            p=n_pieces,
            ahead=ahead_m,
            found=Candidates.zeros(c=n_pairs),
            violations=Candidates.zeros(c=n_pairs),
            working=WorkingSet.zeros(rest=rest, first_sphere=self._end, **sizes),
            capsules=CapsuleMemory.zeros(m=n_pieces, n=self._end - N_TOOL_PIECES, n_apart=self._n_apart),
            beside=BesideJaws.zeros(bound=np.full((N_TOOLS, len(mesh.triangles)), -math.inf)),
            tools_at_start=ToolPoses.zeros(),
            margin_m=self._margin_m,
        )
        self._depths_m = np.zeros(2 * n_pieces)

    def set_strands(self, n_apart: int) -> None:
        """Find contacts of the catheter's segments that are at least so many apart, on the sides they are on now.

        With 0 the catheter does not touch itself.
        """
        self._n_apart = self._arrays.capsules.n_apart = n_apart
        self._arrays.capsules.active[N_TOOL_PIECES : self._end] = 0

    def set_spheres(self, spheres: Spheres) -> None:
        """Find contacts of spheres with wall and catheter too; again once there are more of them."""
        self._make_room(wall_candidates(self._duct, self._end + spheres.count, self._along_m, self._arrays.known))

    @property
    def wall_moved_m(self) -> float:
        """Largest motion in the last step of a node of a candidate, by modes and loads; 0 if nothing was priced."""
        return self._arrays.working.wall_moved_m

    @property
    def clearance_m(self) -> float:
        """How far the wall may move after the step is priced, before it touches a body or what is no candidate."""
        found = self._arrays.found
        return max(float(found.gap_m[: found.count].min(initial=LOOK_AHEAD_M)), 0.0)

    @property
    def n_candidates(self) -> int:
        """Number of candidates that were measured last."""
        return int(self._arrays.found.count)

    @property
    def least_gap_m(self) -> float:
        """Least gap of the candidates that were measured last, negative for an overlap."""
        found = self._arrays.found
        return float(found.gap_m[: found.count].min(initial=math.inf))

    def begin(self, system: ContactSystem) -> None:
        """Place wall and pieces at the start of a step, and choose the candidates that get rows."""
        begin_step(self._arrays.address, system.address, system.bodies.duct.loads_address)

    def restore_start(self) -> None:
        """Measure anew at the start of the next step: bodies are where they were at that of the last one."""
        self._arrays.is_measured = False

    def write_pairs(self, state: Address[ContactState], pairs: ContactPairs) -> None:
        """Append the chosen candidates and pairs with the catheter; engage tools that overlap no body."""
        write_pairs(self._arrays.address, state, pairs.address)

    def price(self, system: ContactSystem, tolerance_m: float, pairs: ContactPairs) -> int:
        """Write pairs of the candidates that end the step too deep, and return their number."""
        duct = system.bodies.duct
        addresses = self._arrays.address, system.address, duct.loads_address
        return int(price_end(addresses, duct.lasting_loads, tolerance_m, pairs.address))

    def depths_m(self, system: ContactSystem, share: float) -> FloatArray:
        """Return how deep each piece is in the wall, and after them in the catheter; a live view.

        Bodies are measured where they are now, stones at ``share`` of the step.
        """
        duct = system.bodies.duct
        addresses = self._arrays.address, system.address, duct.loads_address
        write_depths_now(addresses, duct.lasting_loads, share, self._depths_m)
        return self._depths_m

    def update_working_set(self, state: Address[ContactState]) -> None:
        """Age the working set by a step, and renew the places whose contacts carried a force in it."""
        update_working_set(self._arrays.address, state)

    def count_layers(self, system: ContactSystem, tools: BoolArray, out: LayersOut, fewer: float) -> None:
        """Count the layers of wall that these tools (2,) have in their jaws, by cells (2, N_CELLS); see `layers`.

        ``out`` is (what is counted, what holds): of that more is taken over at once, fewer by ``fewer`` at most.
        """
        count_layers_of(self._arrays.address, system.address, tools, out, fewer)

    def set_catheter_row_gap(self, gap_m: float) -> None:
        """Give the catheter rows from this gap (m) on, for laws that act across a gap."""
        self._catheter_ahead_m = max(gap_m, self._row_gap_m)
        self._make_room(wall_candidates(self._duct, len(self._arrays.ahead), self._along_m, self._arrays.known))

    def forget(self) -> None:
        """Clear the working set, because bodies have been put elsewhere."""
        self._arrays.working.places[:], self._arrays.working.n_members = 0, 0
        self._arrays.known.is_new, self._arrays.is_measured = True, False
        self._arrays.capsules.reset()

    @property
    def dropped(self) -> int:
        """Candidates and entries of lists that exceeded their capacity since the start."""
        arrays = self._arrays
        return int(arrays.known.list.dropped + arrays.found.dropped + arrays.violations.dropped)


@kernel
def begin_step(
    address: Address[SearchArrays], state_address: Address[ContactState], duct_address: Address[DuctLoads]
) -> None:
    """Place wall and pieces where the step starts, measure unless that has been done, and choose candidates."""
    search, state, duct = search_at(address), state_at(state_address), loads_at(duct_address)
    known = search.known
    listed, count = known.list, duct.count[0]
    _write_bodies(listed, state, state.geometry.rod.position, 0.0)
    for p in range(search.start.shape[0]):
        copy_ends(listed, p, search.start)
    if not search.is_measured:
        set_wanted_gaps(listed, search.start, search.ahead, math.inf)
    if follow_wall(known, duct.free.start, (duct.node[:count], duct.force[:count])) or not search.is_measured:
        measure(known, search.found)
    search.is_measured = False
    capacity = state.rows.gap_m.shape[0]
    choose((listed, search.found, search.working), search.ahead, state.geometry.tools, capacity)
    copy_configuration(search.start_wall, known.wall)


@kernel
def price_end(
    addresses: tuple[Address[SearchArrays], Address[ContactState], Address[DuctLoads]],
    lasting: Loads,
    tolerance_m: float,
    pairs_address: Address[ContactPairs],
) -> int:
    """Measure where the step ends, and write the pairs that are too deep there; return their number.

    See `write_violations` and `write_capsule_violations`.
    """
    search, state, duct = search_at(addresses[0]), state_at(addresses[1]), loads_at(addresses[2])
    known, tools, pairs = search.known, state.geometry.tools, pairs_at(pairs_address)
    _measure_now(search, state, duct, lasting, 1.0)
    start, candidates = (search.start, search.start_wall.position), (search.found, search.violations)
    n_pairs = write_violations((known.list, candidates, search.working, state), start, tolerance_m, pairs)
    n_pairs += write_capsule_violations((known.list, search.capsules, state, pairs), search.start, tolerance_m)
    move_back(tools, search.tools_at_start)
    return int(n_pairs)


@kernel
def write_depths_now(
    addresses: tuple[Address[SearchArrays], Address[ContactState], Address[DuctLoads]],
    lasting: Loads,
    share: float,
    out: FloatArray,
) -> None:
    """Measure where the bodies are at ``share`` of the step, and write their depths, see `write_depths`."""
    search, state, duct = search_at(addresses[0]), state_at(addresses[1]), loads_at(addresses[2])
    _measure_now(search, state, duct, lasting, share)
    start, candidates = (search.start, search.start_wall.position), (search.found, search.violations)
    write_depths((search.known.list, candidates, search.capsules, state), start, out)
    move_back(state.geometry.tools, search.tools_at_start)
    search.is_measured = False


@kernel
def _measure_now(search: SearchArrays, state: ContactState, duct: DuctLoads, lasting: Loads, share: float) -> None:
    """Measure the candidates where the bodies are at ``share`` of the step; tools stay posed at their proxies."""
    known, found, start_wall, count = search.known, search.found, search.start_wall, duct.count[0]
    move_to_proxies(state.geometry.tools, search.tools_at_start)
    _write_bodies(known.list, state, state.geometry.rod.position_now, share)
    loads = (duct.node[:count], duct.force[:count]), lasting
    follow_end(known, duct.free.q, loads, (start_wall, search.start), search.ahead)
    measure(known, found)
    for i in range(found.count):
        request_triangle(start_wall, known.list.clusters, found.triangle[i])
    place_requested(start_wall)
    search.is_measured = True


@inlined_kernel
def _write_bodies(listed: CandidateList, state: ContactState, particles: FloatArray, share: float) -> None:
    """Write the pieces of all bodies: where the step starts (``share`` 0) or ends (1)."""
    tools, rod, half_m = state.geometry.tools, state.geometry.rod, state.geometry.wall.half_thickness
    write_pieces(listed, particles, (tools.segments, tools.radius, tools.present), (rod.radius, half_m))
    spheres, rows, first = state.geometry.spheres, state.rows, N_TOOL_PIECES + particles.shape[0] - 1
    for k in range(spheres.count):
        place = along(row(spheres.start, k), row(spheres.motion, k), share)
        for at in range(rows.n_contacts):
            if rows.stone[at] == k:
                place = along(place, row(state.force_n, at), share * spheres.compliance[k])
        put_piece(listed, first + k, (place, place), spheres.radius[k] + half_m)


@kernel
def write_pairs(
    address: Address[SearchArrays], state_address: Address[ContactState], pairs_address: Address[ContactPairs]
) -> None:
    """Append the chosen candidates, and all pairs with the catheter within the margin, and engage tools."""
    search, geometry, pairs = search_at(address), state_at(state_address).geometry, pairs_at(pairs_address)
    tools, rod = geometry.tools, geometry.rod
    found, working, chosen = search.found, search.working, (0, N_TOOL_PIECES)
    follow_rolling(found, working, (search.start, search.start_wall.position), search.known.list.clusters.triangles)
    write_chosen(found, working, chosen, pairs)
    poses = tools.segments, tools.radius, tools.present
    sizes, spheres = (rod.radius, search.margin_m), geometry.spheres
    detect_capsules(search.capsules, pairs, poses, rod.position, sizes)
    write_chosen(found, working, (N_TOOL_PIECES, search.ahead.shape[0]), pairs)
    detect_strands(search.capsules, pairs, rod.position, sizes)
    bodies = spheres.start, spheres.motion, spheres.radius
    detect_spheres(search.capsules, pairs, bodies, spheres.count, rod.position, sizes)
    engage_tools(search.found, pairs, geometry)


@kernel
def count_layers_of(
    address: Address[SearchArrays],
    state_address: Address[ContactState],
    tools: BoolArray,
    out: LayersOut,
    fewer: float,
) -> None:
    """Count the layers between the jaws of those tools (2,) that are named, at the end of the step, and take them over.

    For ``out`` and ``fewer`` see `CandidateSearch.count_layers`.
    """
    search, geometry = search_at(address), state_at(state_address).geometry
    for tool in range(tools.shape[0]):
        if tools[tool]:
            frame = search.tools_at_start.frame[tool]
            counted, layers = out[0][tool], out[1][tool]
            count_layers(search.known.list, search.beside, geometry, tool, frame, counted)
            for cell in range(counted.shape[0]):
                layers[cell] = max(counted[cell], layers[cell] - fewer)


@kernel
def update_working_set(address: Address[SearchArrays], state_address: Address[ContactState]) -> None:
    """Age the working set by a step, and renew the places whose contacts carry a normal force."""
    working, rows = search_at(address).working, state_at(state_address).rows
    age_members(working, rows.dt_s)
    for at in range(rows.n_contacts):
        identity = rows.identity[at]
        is_wall = identity >= 0 and HAS_GAP[rows.law[at]]
        if is_wall and part_of(identity, TARGET_KIND) == DUCT_TRIANGLE and rows.force_n[at, 0] > 0.0:
            p = piece_of(rows, at)
            if 0 <= p < working.places.shape[0]:
                renew_member(working, p, part_of(identity, TARGET), row(rows.duct_weight, at))
