"""State of hands, catheter and tissue at one time, in the judged quantities, from the frames of the bus."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from trocar.protocol.bodies import GatewayState, PhysicsState, ToolContacts
from trocar.protocol.bodies.haptics import TOOL_PORT
from trocar.protocol.bodies.physics import (
    REACTION_FORCE,
    REACTION_GRASP_TORQUE,
    REACTION_OPENING,
    REACTION_POSITION,
    REACTION_PROXY,
)
from trocar.protocol.topics import TICK_S
from trocar.services.training.site import Site

Vector = NDArray[np.float64]
TISSUES = ("tool_duct", "tool_catheter", "catheter_wall")
"""Kinds of contact, in the order of their numbers on the wire."""

EVERY_TICKS = 4
"""Ticks between judged situations: 250 a second, for motion up to 10 Hz."""
_DUCT, _CATHETER, _WALL = 0, 1, 2

# Assumptions, in terms of the catheter, 1.7 mm thick (5 Fr), and of a cell of the wall's mesh, about 2 mm long:
#: Contacts of the tip, and of the mouth's rim, lie within a cell and the catheter's radius; those of a clip twice as
#: far, as its jaws are 5 mm wide.
_TIP_REACH_M = _RIM_REACH_M = 3e-3
_CLIP_REACH_M = 2 * _RIM_REACH_M
#: Time over which a speed of insertion is taken: at the least one that counts (`stalled_m_s`) 0.05 mm pass, more than
#: the inserted length is uncertain by; and shorter than a person needs to react.
_ADVANCE_S = 0.25

_FREE_M = 5e-3
"""Shortest free length of catheter considered for buckling, as its arc hardly differs from its chord below."""
_FLUSH_BUTTON = 1 << 1  # the second button, as the first begins anew
_JAWS_M = 12e-3  # between 15 and 10 mm of usual forceps, as the wire does not tell those of the scene
_LONGEST_JAWS_M, _JAW_M = 30e-3, 2e-3
"""Largest distance of jaw contacts from the junction, for jaws of 28 mm at most, and beside their cone of a right
angle."""
#: Torque by which a held body opens the jaws: 10 mN at a lever of 20 mm. Less is the touch of open jaws.
_SQUEEZED_NM = 0.2e-3
_ZERO = np.zeros(3)
_REMEMBERED = 16  # device frames and tools wait for the state of their tick, which comes one to five ticks later
_Fast = TypeVar("_Fast", GatewayState, ToolContacts)


@dataclass(slots=True)
class Hand:
    """One instrument. ``force_n`` (3,) acts on it; ``hold_m`` is the held point of the catheter along and beside it.

    ``jaw_rad`` is the commanded opening, ``closed_rad`` the opening at the grasp; ``squeeze_nm`` is the torque by which
    the held body keeps the jaws open.
    """

    name: str = ""
    position_m: Vector = field(default_factory=lambda: _ZERO)
    port_m: Vector = field(default_factory=lambda: _ZERO)
    proxy_m: Vector = field(default_factory=lambda: _ZERO)
    speed_m_s: float = 0.0
    force_n: Vector = field(default_factory=lambda: _ZERO)
    jaw_rad: float = 0.0
    squeeze_nm: float = 0.0
    has_force: bool = True
    holds_catheter: bool = False
    grips_duct: bool = False
    hold_id: int = -1
    closed_rad: float = 0.0
    hold_m: tuple[float, float] | None = None

    @property
    def load_n(self) -> float:
        """Size of the force on the instrument."""
        return _length(self.force_n)


@dataclass(slots=True)
class Situation:
    """The situation at one time. Forces in N, lengths in m; None if unknown.

    ``tissue_n`` is, per kind of contact, the load of the more loaded side: of collinear forces the larger of the sums
    in either direction. ``squeeze_n`` is the common load of both sides, which has no resultant. ``clip_n`` is that with
    which the duct is closed on the catheter, by a clip (``clipped_n``) or by jaws in its place.
    """

    tick: int
    hands: list[Hand]
    tip_m: Vector
    inserted_m: float
    advance_m_s: float = 0.0
    tissue_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    squeeze_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_n: float = 0.0
    rim_n: float = 0.0
    rim_opening: float | None = None
    clip_n: float = 0.0
    clipped_n: float = 0.0
    penetration_m: float = 0.0
    push_n: float = 0.0
    arc_over_chord: float = 1.0
    bend_radius_m: float = math.inf
    direction_cosine: float | None = None
    to_mouth_m: float | None = None
    shafts_apart_m: float = math.inf
    view_angle_rad: tuple[float, ...] = ()
    flushing: bool = False

    @property
    def catheter_hands(self) -> list[Hand]:
        """The hands that hold the catheter."""
        return [hand for hand in self.hands if hand.holds_catheter]


class SituationReader:
    """Combines the newest frames of the fast topics."""

    def __init__(self, site: Site | None = None) -> None:
        self._site = site
        self._mouth_m = np.array(site.mouth_m) if site else None
        self._inward = np.array(site.inward) if site else _ZERO
        self._clip_inward = np.array(site.clip_inward) if site else _ZERO
        self._eye_m: Vector | None = None
        if site is not None and site.eye_m is not None and site.looks_at_m is not None:
            self._eye_m, self._axis = np.array(site.eye_m), np.subtract(site.looks_at_m, site.eye_m)
        self._gateway: GatewayState | None = None
        self._contacts: ToolContacts | None = None
        self._devices: deque[GatewayState] = deque(maxlen=_REMEMBERED)
        self._tools: deque[ToolContacts] = deque(maxlen=_REMEMBERED)
        self._due_tick = 0
        self._advance: deque[tuple[int, float]] = deque()

    def take_body(self, topic: str, body: msgspec.Struct) -> Situation | None:
        """Process a frame; return a situation with each state of physics at least `EVERY_TICKS` after the last.

        It is joined with the devices and tools of its tick, or the newest ones if those have not been seen.
        """
        if isinstance(body, GatewayState):
            self._devices.append(body)
        elif isinstance(body, ToolContacts):
            self._tools.append(body)
        elif isinstance(body, PhysicsState) and body.tick >= self._due_tick and body.catheter.position_m.shape[0] > 1:
            self._due_tick = body.tick - body.tick % EVERY_TICKS + EVERY_TICKS
            self._gateway, self._contacts = _of_tick(body.tick, self._devices), _of_tick(body.tick, self._tools)
            return self._situation(body)
        return None

    def _situation(self, state: PhysicsState) -> Situation:
        particles = state.catheter.position_m.view()
        inserted_m = state.catheter.inserted_length_m
        s = Situation(
            state.tick, self._hands(state), particles[-1], inserted_m, self._advance_of(state.tick, inserted_m)
        )
        rod = _Rod(particles)
        s.bend_radius_m = rod.bend_radius_m()
        s.penetration_m = state.contacts.max_penetration_m
        entry = rod.behind_tip(inserted_m) if inserted_m > 0.0 else None
        self._take_mouth(s, state, rod, entry)
        self._take_contacts(s, state, entry)
        self._take_holds(s, state, rod, entry)
        self._take_tools(s)
        return s

    def _hands(self, state: PhysicsState) -> list[Hand]:
        table = state.tools.view()
        hands = [
            Hand(
                str(k),
                row[REACTION_POSITION : REACTION_POSITION + 3],
                proxy_m=row[REACTION_PROXY : REACTION_PROXY + 3],
                force_n=row[REACTION_FORCE : REACTION_FORCE + 3],
                jaw_rad=float(row[REACTION_OPENING]),
                squeeze_nm=float(row[REACTION_GRASP_TORQUE]),
            )
            for k, row in enumerate(table)
        ]
        if self._contacts is not None:
            for hand, row in zip(hands, self._contacts.tools.view(), strict=False):
                hand.port_m = row[TOOL_PORT : TOOL_PORT + 3]
        if self._gateway is not None:
            for hand, told in zip(hands, self._gateway.instruments, strict=False):
                hand.name, hand.has_force = told.name, told.has_force
                hand.speed_m_s = math.hypot(*told.velocity_m_s)
        return hands

    def _advance_of(self, tick: int, inserted_m: float) -> float:
        past = self._advance
        past.append((tick, inserted_m))
        while len(past) > 1 and (tick - past[0][0]) * TICK_S > _ADVANCE_S:
            past.popleft()
        seconds = (tick - past[0][0]) * TICK_S
        return (inserted_m - past[0][1]) / seconds if seconds > 0.0 else 0.0

    def _take_mouth(self, s: Situation, state: PhysicsState, rod: _Rod, entry: Vector | None) -> None:
        site = self._site
        if site is None or self._mouth_m is None:
            return
        s.to_mouth_m = _length(s.tip_m - (self._mouth_m if entry is None else entry))
        if entry is not None:
            s.direction_cosine = float(rod.tangent(rod.arc_m[-1]) @ self._inward)
        q = state.duct.q.view()
        if state.duct.basis_hash == site.basis_hash and len(q) == len(site.rim_gain):
            way_m = float(np.dot(site.rim_gain, q))
            ratio = max(0.0, 1.0 + way_m / site.mouth_radius_m)
            s.rim_opening = ratio * ratio  # may be infinite, for which a power would raise

    def _take_contacts(self, s: Situation, state: PhysicsState, entry: Vector | None) -> None:
        kind = state.contacts.kind.view()
        if not kind.size:
            return
        force, point = state.contacts.force_n.view(), state.contacts.point_m.view()
        loads, found = Loads(force), set(kind.tolist())
        of = [kind == each for each in range(3)]
        pairs = [loads.sides(each) if k in found else (0.0, 0.0) for k, each in enumerate(of)]
        s.tissue_n = (pairs[0][0], pairs[1][0], pairs[2][0])
        s.squeeze_n = (pairs[0][1], pairs[1][1], pairs[2][1])
        if _WALL in found:
            s.tip_n = loads.net(of[_WALL] & (_distances(point, s.tip_m) < _TIP_REACH_M))
        mouth = entry if entry is not None else self._mouth_m
        if mouth is None:
            return
        away_m = _distances(point, mouth)
        radius_m = self._site.mouth_radius_m if self._site else _RIM_REACH_M
        s.rim_n = loads.net((of[0] | of[2]) & (away_m < radius_m + _RIM_REACH_M))
        s.clip_n = loads.sides(of[0] & (away_m < radius_m + _CLIP_REACH_M))[1]
        if self._site is not None and self._site.clip_m is not None:
            under = _distances(point, np.array(self._site.clip_m)) < self._site.clip_reach_m
            across = Loads(force - np.outer(force @ self._clip_inward, self._clip_inward))  # a pull is no pressure
            s.clipped_n = across.sides(of[2] & under)[1]
            s.clip_n = max(s.clipped_n, across.sides(of[0] & under)[1])

    def _take_holds(self, s: Situation, state: PhysicsState, rod: _Rod, entry: Vector | None) -> None:
        if self._contacts is None:
            return
        pressed_m = _pressed_duct(state)
        for hand in s.hands:
            hand.grips_duct = hand.squeeze_nm > _SQUEEZED_NM and _are_between_jaws(hand, pressed_m)
        for hold in self._contacts.holds:
            if hold.tool >= len(s.hands):
                continue
            hand = s.hands[hold.tool]
            hand.hold_id, hand.closed_rad = hold.hold_id, hold.jaw_angle_rad
            if hold.target_kind == _DUCT:
                hand.grips_duct = True
            elif hold.target + 1 < len(rod.points):
                hand.holds_catheter, hand.grips_duct = True, False
                self._take_catheter_hold(s, hand, rod, float(hold.target + hold.target_weights[1]), entry)

    def _take_catheter_hold(self, s: Situation, hand: Hand, rod: _Rod, at: float, entry: Vector | None) -> None:
        """Compute a hand's action on the catheter, held at a place counted in segments."""
        arc_m = rod.arc_at(at)
        point, tangent = rod.point(arc_m), rod.tangent(arc_m)
        s.push_n = max(s.push_n, -float(hand.force_n @ tangent))
        hand.hold_m = _in_tool(hand, point)
        end_m = rod.arc_m[-1] - (s.inserted_m if entry is not None else 0.0)
        chord_m = _length((s.tip_m if entry is None else entry) - point)
        if end_m - arc_m > _FREE_M and chord_m > 0.0:
            s.arc_over_chord = max(s.arc_over_chord, (end_m - arc_m) / chord_m)

    def _take_tools(self, s: Situation) -> None:
        if self._gateway is not None:
            s.flushing = any(told.buttons & _FLUSH_BUTTON for told in self._gateway.instruments)
        if self._contacts is not None and len(s.hands) > 1:
            (a, b), (c, d) = (_shaft(hand) for hand in s.hands[:2])
            s.shafts_apart_m = segments_apart_m(a, b, c, d)
        if self._eye_m is not None:
            s.view_angle_rad = tuple(_angle(_shaft(hand)[1] - self._eye_m, self._axis) for hand in s.hands)


def _of_tick(tick: int, frames: deque[_Fast]) -> _Fast | None:
    """Return the frame of a tick, else the newest."""
    return next((each for each in reversed(frames) if each.tick == tick), frames[-1] if frames else None)


class _Rod:
    """The centreline (n, 3) by arc length from its proximal end; the tip is last."""

    def __init__(self, points: Vector) -> None:
        self.points = points
        self._edges = points[1:] - points[:-1]
        self._lengths = np.sqrt(np.einsum("ij,ij->i", self._edges, self._edges))
        self.arc_m = np.zeros(len(points))
        np.cumsum(self._lengths, out=self.arc_m[1:])

    def arc_at(self, place: float) -> float:
        """Return the arc length at a place counted in segments."""
        k = min(max(int(place), 0), len(self._lengths) - 1)
        begin_m, end_m = self.arc_m[k : k + 2].tolist()
        return float(begin_m + (end_m - begin_m) * min(max(place - k, 0.0), 1.0))

    def point(self, arc_m: float) -> Vector:
        k = self._segment(arc_m)
        begin_m, end_m = self.arc_m[k : k + 2].tolist()
        if not begin_m < arc_m < end_m:
            end: Vector = self.points[k + int(arc_m >= end_m)]
            return end
        point: Vector = self._edges[k] / (end_m - begin_m) * (arc_m - begin_m) + self.points[k]
        return point

    def behind_tip(self, length_m: float) -> Vector:
        return self.point(self.arc_m[-1] - length_m)

    def tangent(self, arc_m: float) -> Vector:
        """Return the unit vector towards the tip."""
        k = self._segment(arc_m)
        tangent: Vector = self._edges[k] / max(self._lengths[k], 1e-12)
        return tangent

    def _segment(self, arc_m: float) -> int:
        return min(max(int(self.arc_m.searchsorted(arc_m, side="right")) - 1, 0), len(self._lengths) - 1)

    def bend_radius_m(self) -> float:
        """Return the smallest radius of circles that are tangent to two neighbouring segments at their middles."""
        if len(self._lengths) < 2:
            return math.inf
        lengths = np.maximum(self._lengths, 1e-12)
        cosines = np.einsum("ij,ij->i", self._edges[1:], self._edges[:-1]) / (lengths[1:] * lengths[:-1])
        tangents = np.sqrt(np.maximum(1.0 - cosines, 0.0) / np.maximum(1.0 + cosines, 1e-12))
        curvature = float((4.0 * tangents / (lengths[1:] + lengths[:-1])).max())
        return 1.0 / curvature if curvature > 0.0 else math.inf


class Loads:
    """Sums over subsets of the forces (n, 3)."""

    def __init__(self, force: Vector) -> None:
        self._force = force
        self._size = np.sqrt(np.einsum("ij,ij->i", force, force))

    def net(self, of: NDArray[np.bool_]) -> float:
        """Return the size of the resultant of the forces selected by `of` (n,)."""
        return _length(of.astype(float) @ self._force)

    def sides(self, of: NDArray[np.bool_]) -> tuple[float, float]:
        """Return the load of the more loaded side of these forces, and the common load of both sides."""
        total, net = float(of.astype(float) @ self._size), self.net(of)
        return 0.5 * (total + net), 0.5 * (total - net)


def segments_apart_m(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Return the distance of the segments ab and cd (Ericson, Real-Time Collision Detection, 5.1.9)."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = float(u @ u), float(u @ v), float(v @ v), float(u @ w), float(v @ w)
    if uu == 0.0 or vv == 0.0:
        s, t = (0.0, _share(vw, vv)) if uu == 0.0 else (_share(-uw, uu), 0.0)
    else:
        s = _share(uv * vw - uw * vv, uu * vv - uv * uv)
        t = (uv * s + vw) / vv
        if not 0.0 <= t <= 1.0:
            t = min(max(t, 0.0), 1.0)
            s = _share(uv * t - uw, uu)
    return _length(w + s * u - t * v)


def _share(part: float, whole: float) -> float:
    return min(max(part / whole, 0.0), 1.0) if whole > 0.0 else 0.0


def _shaft(hand: Hand) -> tuple[Vector, Vector]:
    """Return the ends of an instrument from its port to the tips of its jaws."""
    along = hand.position_m - hand.port_m
    return hand.port_m, hand.position_m + along * (_JAWS_M / max(_length(along), 1e-9))


def _in_tool(hand: Hand, point: Vector) -> tuple[float, float]:
    """Return a point's distances along and beside the shaft of an instrument, at its proxy."""
    along, away = hand.position_m - hand.port_m, point - hand.proxy_m
    axial_m = float(away @ along) / max(_length(along), 1e-9)
    return axial_m, math.sqrt(max(float(away @ away) - axial_m * axial_m, 0.0))


def _pressed_duct(state: PhysicsState) -> Vector:
    """Return the points (n, 3) at which tools press the duct."""
    contacts = state.contacts
    is_pressed = (contacts.kind.view() == _DUCT) & contacts.force_n.view().any(axis=1)
    pressed: Vector = contacts.point_m.view()[is_pressed]
    return pressed


def _are_between_jaws(hand: Hand, points: Vector) -> bool:
    """Return whether any of some points (n, 3) is between the jaws of an instrument."""
    along, away = hand.position_m - hand.port_m, points - hand.proxy_m
    axial_m = away @ along / max(_length(along), 1e-9)
    beside_m = np.sqrt(np.maximum(np.einsum("ij,ij->i", away, away) - axial_m * axial_m, 0.0))
    is_between = (axial_m > 0.0) & (axial_m < _LONGEST_JAWS_M) & (beside_m < axial_m + _JAW_M)
    return bool(is_between.any())


def _length(vector: Vector) -> float:
    return math.sqrt(vector @ vector)


def _distances(points: Vector, place: Vector) -> Vector:
    away = points - place
    distances: Vector = np.sqrt(np.einsum("ij,ij->i", away, away))
    return distances


def _angle(one: Vector, other: Vector) -> float:
    return math.acos(min(max(float(one @ other) / max(_length(one) * _length(other), 1e-12), -1.0), 1.0))
