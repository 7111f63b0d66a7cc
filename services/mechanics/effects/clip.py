"""A clip on the duct that holds the catheter, as for cholangiography through the cystic duct."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.contact.clip_rows import (
    N_LEGS,
    Clip,
    append_clip,
    find_catheter,
    follow_clip,
    turn_plates,
)
from trocar.services.mechanics.contact.system import STRATEGIES
from trocar.services.mechanics.effects.base import Effect, require_positive
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.wall_bar import WallBar
from trocar.services.mechanics.surface.cross_section import (
    CrossSection,
    SurfacePoint,
    pierced_m,
    section_behind_mouth,
)
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.world import World

_LEG_HIGH_M, _ENDS_M = 0.8e-3, 2e-3
"""Of a leg in the picture: its height, and how much longer it is than half the circumference; assumptions."""


@dataclass(frozen=True, slots=True)
class ClipSettings:
    """Place behind the mouth and direction in which the clip closes; its force, and how fast that grows.

    It closes ``at_start``, or ``by_jaws``: once jaws squeeze duct and catheter there with the force of the clip. The
    leg is ``leg_width_m`` wide along the duct. No force of a clip on a duct is published: 1 N is an assumption.
    """

    at_m: float = 6e-3
    closes_along: tuple[float, float, float] = (0.0, 0.0, 1.0)
    closing_force_n: float = 1.0
    closing_time_s: float = 0.2
    leg_width_m: float = 1.5e-3
    closes: Literal["at_start", "by_jaws"] = "at_start"

    def __post_init__(self) -> None:
        require_positive(self, "at_m", "closing_force_n", "closing_time_s", "leg_width_m")
        if not any(self.closes_along):
            raise ValueError("closes_along must not be zero")


class ClipEffect(Effect):
    """Two legs that press the wall on the catheter from both sides with a constant force, see `contact.clip_rows`.

    With the force N of the clip and the force R by which the wall resists being pressed so far, each side of the
    catheter is pressed by N - R. So it slips along the duct at 2 mu (N - R), mu being that of the effect ``friction``.
    A pressure p in the duct lifts the legs where p times the area of the flattened lumen under them, leg width times
    half the lumen's circumference, is N - R: there it leaks. Where the catheter does not pass the clip, or has been
    pulled out, the clip lies open, as nothing is known of a wall that touches itself.
    """

    Settings = ClipSettings

    def __init__(self, settings: ClipSettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        if STRATEGIES[scene.contact.model].acts_in_next_step:
            raise ValueError("effects.clip: needs contact.model implicit, a penalty knows no constant force of a clip")
        self._state: Clip | None = None
        self._closes_along = np.zeros((1, 3))
        self._flattened_m2, self._turns, self._motion_m = math.nan, False, np.zeros((0, 3))

    def check_mesh(self, mesh: TriangleMesh) -> None:
        """Raise a ValueError if the duct has no wall on both sides at the clip's place."""
        _legs(mesh, self.settings)

    def prepare(self, world: World) -> None:
        """Find the places of the legs on the wall."""
        settings = self.settings
        section, points = _legs(world.duct.reduced.mesh, settings)
        places = np.array([point.place_m for point in points])
        apart = places[1] - places[0]
        away = apart / np.linalg.norm(apart)
        self._closes_along = away[None]
        self._state = Clip.zeros(
            triangle=np.array([point.triangle for point in points], np.int32),
            weights=np.array([point.weights for point in points]),
            rest_m=places,
            place_m=places.copy(),
            towards=np.stack([away, -away]),
            inward=section.inward.copy(),
            row=np.full(N_LEGS, -1, np.int32),
            pull=np.full(N_LEGS, -1, np.int32),
            reach_m=section.reach_m,
            closing_n=settings.closing_force_n,
            rate_n_s=settings.closing_force_n / settings.closing_time_s,
            is_closed=settings.closes == "at_start",
        )
        self._turns, self._motion_m = world.duct.reduced.warp is not None, np.zeros_like(world.duct.motion_m)
        lumen_m = section.radius_m - 0.5 * self.scene.duct.thickness_m
        self._flattened_m2 = settings.leg_width_m * math.pi * lumen_m

    def add_rows(self, world: World, dt_s: float) -> None:
        """Let the force of a closed clip grow, or end where the catheter has left it; append the rows of the legs."""
        addresses, state = (world.system.address, self.state.address), self.state
        if self._turns:
            state.towards[0] = self._across(world)
            state.towards[1] = -state.towards[0]
        self._change_pull(world, dt_s, is_passed=find_catheter(*addresses))
        append_clip(*addresses)

    def add_motion(self, world: World, dt_s: float) -> None:
        """Let the plates turn with the wall's sections in the rows of the legs."""
        if self._turns and self.state.row[0] >= 0:
            duct, k = world.duct, world.system.rows.n_contacts
            wall, motion_m = (duct.sections[0], duct.loads_address), self._motion_m[:k]
            turn_plates(world.system.address, self.state.address, wall, motion_m)
            world.system.add_duct_motion(motion_m)

    def _across(self, world: World) -> FloatArray:
        """Return the unit vector (3,) across the plates to the other leg, where the sections were placed last."""
        node = world.duct.reduced.mesh.triangles[self.state.triangle[:1], 0]
        across: FloatArray = world.duct.turn_to_world(node, self._closes_along)[0]
        return across

    def _change_pull(self, world: World, dt_s: float, *, is_passed: bool) -> None:
        state = self.state
        grown_n = min(state.rate_n_s * dt_s, state.closing_n - state.pull_n) if is_passed else -state.pull_n
        if not state.is_closed or grown_n == 0.0:
            return
        first_m, second_m = map(world.duct.point_at_start, state.triangle, state.weights)
        work_j = grown_n * float(state.towards[0] @ (second_m - first_m))
        if is_passed:
            state.given_j += work_j
        else:
            state.lost_j -= work_j
        state.pull_n += grown_n

    def after_solve(self, world: World, dt_s: float) -> None:
        """Follow the wall, and close where jaws squeeze the duct with the force of the clip."""
        state = self.state
        follow_clip(world.system.address, state.address, world.duct.displacement_m)
        if not state.is_closed and state.segment >= 0 and state.squeezed_n >= state.closing_n:
            state.is_closed = True

    def place_m(self, mesh: TriangleMesh) -> FloatArray:
        """Return the middle of the clip, its reach, and the direction of the duct there."""
        section = _section(mesh, self.settings)
        return np.concatenate([section.middle_m, [section.reach_m], section.inward])

    def bars(self, mesh: TriangleMesh) -> tuple[WallBar, ...]:
        """Return both legs, as long as the duct is wide when it is pressed flat."""
        section, points = _legs(mesh, self.settings)
        size_m = 0.5 * math.pi * section.radius_m + _ENDS_M, self.settings.leg_width_m, _LEG_HIGH_M
        bars = []
        for point, other in (points, points[::-1]):
            out = point.place_m - other.place_m
            out /= np.linalg.norm(out)
            across = np.cross(section.inward, out)
            corners = mesh.triangles[point.triangle]
            nodes = int(corners[0]), int(corners[1]), int(corners[2])
            bars.append(WallBar(nodes, _three(point.weights), _three(across), _three(out), size_m))
        return tuple(bars)

    @property
    def state(self) -> Clip:
        """The clip as it is. Raises RuntimeError before `prepare`."""
        if self._state is None:
            raise RuntimeError("the clip is not on a duct yet")
        return self._state

    @property
    def leak_pressure_pa(self) -> float:
        """Pressure in the duct above which the clip leaks; zero while it does not press the catheter."""
        return self.state.pressing_n / self._flattened_m2

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return all of the clip's state."""
        words, *arrays = self.state.own_memory()
        return words, *arrays

    def potential_energy_j(self, world: World) -> float:
        """Return what the springs of the legs can still do: their force times the distance of the legs across them."""
        state, surface_m = self.state, world.duct.surface_m()
        corners = world.duct.reduced.mesh.triangles[state.triangle]
        places_m = np.einsum("lc,lck->lk", state.weights, surface_m[corners])
        return float(state.pull_n * self._across(world) @ (places_m[1] - places_m[0]))

    @property
    def dissipated_j(self) -> float:
        """What the spring had stored when the catheter left the clip."""
        return self.state.lost_j

    @property
    def given_j(self) -> float:
        """Work of whoever closes the clip."""
        return self.state.given_j


def _section(mesh: TriangleMesh, settings: ClipSettings) -> CrossSection:
    try:
        return section_behind_mouth(mesh, settings.at_m)
    except ValueError as error:
        raise ValueError(f"effects.clip.at_m: {error}") from None


def _legs(mesh: TriangleMesh, settings: ClipSettings) -> tuple[CrossSection, tuple[SurfacePoint, SurfacePoint]]:
    """Return the section at the clip, and the points of the wall under its legs."""
    section = _section(mesh, settings)
    try:
        across = section.across(settings.closes_along)
    except ValueError as error:
        raise ValueError(f"effects.clip.closes_along: {error}") from None
    points = pierced_m(mesh, section.middle_m, -across), pierced_m(mesh, section.middle_m, across)
    if points[0] is None or points[1] is None:
        raise ValueError("effects.clip.at_m: the duct has no wall on both sides there, it is cut open")
    return section, (points[0], points[1])


def _three(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
