"""Bubbles of air in contrast agent: balls that come out of a catheter's tip, are carried, rise, and leave a lumen.

A bubble moves with the mean velocity of the fluid in its cell, and rises through it at its terminal speed. It stays a
ball: it glides along the wall, and where the lumen is narrower than the ball it stops; a real one is pressed through by
a pressure of 2 sigma (1 / r - 1 / R), some tens of pascals, which an injection has. A long bubble that fills a tube
does not rise below rho g r^2 / sigma = 0.842 (Bretherton, J. Fluid Mech. 10, 1961), in bile below a radius of some
2 mm; the rise of a ball falls to nothing as it fills the lumen, which is the same for all ducts but the widest.
Above a radius of a millimetre real bubbles flatten and rise more slowly than a ball does.
Bubbles do not hinder the flow, meet neither catheter nor stones nor each other, and do not dissolve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import KDTree

from trocar.review.export.contrast_flow import SteadyFlow
from trocar.review.export.displacers import Displacer, ball
from trocar.review.export.filled_lumen import FilledLumen
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.primitives import closest_on_triangle
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, combine, row_of, subtract
from trocar.services.mechanics.scene.air_bubble import AirBubble

VISCOSITY_PA_S, DENSITY_KG_M3 = 1.7e-3, 1170.0
"""Of agent with 150 mg of iodine per ml at 37 degrees, because iohexol has 1.5 mPa s and 1164 kg/m3 at 140 mg, and 2.0
mPa s and 1209 kg/m3 at 180 mg (label of Omnipaque)."""
_LONGEST_STEP = 0.5
"""Longest step in radii, so that the middle of a ball that touches the wall stays inside of it."""
_TURNS = 8
"""How often a ball is pushed off what is nearest, as each time it comes off one of the walls of a corner only."""
_SLACK_M = 1e-6
"""How much deeper in a wall a ball may come by rounding."""


def rise_speed_m_s(radius_m: float, lumen_radius_m: float, gravity_m_s2: float) -> float:
    """Return the terminal speed of a bubble in the middle of a tube, zero where it fills it.

    Weight against drag of a rigid ball, as surfactants such as bile salts hold the surface of a bubble still: 24 / Re
    (1 + 0.15 Re^0.687), Schiller and Naumann 1933. Times the effect of the wall, Di Felice, Int. J. Multiphase Flow 22,
    1996: ((1 - x) / (1 - 0.33 x))^a with x the ratio of the radii, (3.3 - a) / (a - 0.85) = 0.1 Re.
    """
    if gravity_m_s2 <= 0.0 or radius_m >= lumen_radius_m:
        return 0.0
    per_speed = 2.0 * radius_m * DENSITY_KG_M3 / VISCOSITY_PA_S
    stokes_m_s = 2.0 * DENSITY_KG_M3 * gravity_m_s2 * radius_m**2 / (9.0 * VISCOSITY_PA_S)
    free_m_s = brentq(lambda u: u * (1.0 + 0.15 * (u * per_speed) ** 0.687) - stokes_m_s, 0.0, stokes_m_s)
    reynolds, ratio = free_m_s * per_speed, radius_m / lumen_radius_m
    exponent = (3.3 + 0.085 * reynolds) / (1.0 + 0.1 * reynolds)
    return float(free_m_s * ((1.0 - ratio) / (1.0 - 0.33 * ratio)) ** exponent)


class Bubbles:
    """The bubbles of a catheter.

    Args:
        bubbles: All of them.
        gravity_m_s2: (3,). Against which they rise; zero where nothing weighs.

    Attributes:
        waiting: Those that have not come out of the tip, in the order in which they will.
        inside, places_m: Those that are in the lumen, and where (k, 3).
        left: Those that have left it.
    """

    def __init__(self, bubbles: Sequence[AirBubble], gravity_m_s2: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self.waiting = sorted(bubbles, key=lambda bubble: bubble.after_m3)
        self.inside: list[AirBubble] = []
        self.left: list[AirBubble] = []
        self.places_m: FloatArray = np.zeros((0, 3))
        self._gravity_m_s2 = np.array(gravity_m_s2, float)
        self._wall: _Wall | None = None

    def come_out(self, injected_m3: float, tip_m: FloatArray) -> None:
        """Let those come out at a tip (3,) that are due once so much agent has been injected."""
        while self.waiting and self.waiting[0].after_m3 <= injected_m3:
            self.inside.append(self.waiting.pop(0))
            self.places_m = np.concatenate([self.places_m, tip_m[None]])

    def displacers(self) -> list[Displacer]:
        """Return those in the lumen as bodies."""
        return [ball(place_m, bubble.radius_m) for bubble, place_m in zip(self.inside, self.places_m, strict=True)]

    def move(self, lumen: FilledLumen, flow: SteadyFlow, duration_s: float) -> None:
        """Carry and raise those in the lumen for so long, and part with those that come out of an outlet."""
        if not self.inside:
            return
        if self._wall is None or self._wall.lumen is not lumen:
            self._wall = _Wall(lumen)
        fluid_m_s = lumen.velocities_m_s(flow)
        ends = [
            self._moved(bubble, place_m, (self._wall, fluid_m_s), duration_s)
            for bubble, place_m in zip(self.inside, self.places_m, strict=True)
        ]
        stays = [end is not None for end in ends]
        self.left += [bubble for bubble, stay in zip(self.inside, stays, strict=True) if not stay]
        self.inside = [bubble for bubble, stay in zip(self.inside, stays, strict=True) if stay]
        self.places_m = np.array([end for end in ends if end is not None]).reshape(-1, 3)

    def _moved(
        self, bubble: AirBubble, place_m: FloatArray, where: tuple[_Wall, FloatArray], duration_s: float
    ) -> FloatArray | None:
        """Return where a bubble is after so long, None outside."""
        wall, fluid_m_s = where
        lumen, left_s = wall.lumen, duration_s
        while left_s > 0.0:
            cell = int(lumen.cells_at(place_m[None])[0])
            velocity_m_s = fluid_m_s[cell] + self._rise_m_s(bubble.radius_m, lumen.radii_m[cell])
            speed_m_s = max(float(np.linalg.norm(velocity_m_s)), 1e-12)
            step_s = min(left_s, _LONGEST_STEP * bubble.radius_m / speed_m_s)
            left_s -= step_s
            to_m = wall.beside_wall_m(place_m, place_m + step_s * velocity_m_s, bubble.radius_m)
            if cell in wall.at_openings and not lumen.cells.contains(lumen.corners_m, to_m[None])[0]:
                if cell in lumen.outlets[:, 1]:
                    return None
                return place_m
            place_m = to_m
        return place_m

    def _rise_m_s(self, radius_m: float, lumen_radius_m: float) -> FloatArray:
        gravity_m_s2 = float(np.linalg.norm(self._gravity_m_s2))
        if gravity_m_s2 == 0.0:
            return np.zeros(3)
        speed_m_s = rise_speed_m_s(radius_m, lumen_radius_m, gravity_m_s2)
        velocity_m_s: FloatArray = -speed_m_s / gravity_m_s2 * self._gravity_m_s2
        return velocity_m_s


class _Wall:
    """The wall of a lumen, of which a ball touches but a few triangles.

    Attributes:
        lumen: Whose wall it is.
        at_openings: The cells at openings.
    """

    def __init__(self, lumen: FilledLumen) -> None:
        self.lumen = lumen
        self._corners_m = lumen.corners_m[lumen.cells.triangles[lumen.cells.wall]]
        middles_m = self._corners_m.mean(axis=1)
        self._reach_m = float(np.linalg.norm(self._corners_m - middles_m[:, None], axis=2).max())
        self._tree = KDTree(middles_m)
        self.at_openings = {int(cell) for cells in lumen.cells.opening_cells for cell in cells}

    def beside_wall_m(self, from_m: FloatArray, to_m: FloatArray, radius_m: float) -> FloatArray:
        """Return where a ball comes to: pushed off the wall, or where it was if it does not fit in there."""
        near = self._tree.query_ball_point(from_m, (1.0 + 2.0 * _LONGEST_STEP) * radius_m + self._reach_m)
        if not near:
            return to_m
        corners_m = self._corners_m[near]
        least_m = min(distance_m(from_m, corners_m), radius_m) - _SLACK_M
        end_m = to_m.copy()
        for _ in range(_TURNS):
            push_off(end_m, radius_m, corners_m)
        return end_m if distance_m(end_m, corners_m) > least_m else from_m


@kernel
def distance_m(place: FloatArray, corners: FloatArray) -> float:
    """Return the distance of a place (3,) from the nearest of triangles (m, 3, 3)."""
    offset = _from_nearest((place[0], place[1], place[2]), corners)
    return math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)


@kernel
def push_off(place: FloatArray, radius: float, corners: FloatArray) -> None:
    """Move a ball's middle (3,) off the nearest of triangles (m, 3, 3), if that is nearer than its radius."""
    offset = _from_nearest((place[0], place[1], place[2]), corners)
    distance = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
    if 0.0 < distance < radius:
        for axis in range(3):
            place[axis] += (radius - distance) / distance * offset[axis]


@kernel
def _from_nearest(place: Vector, corners: FloatArray) -> Vector:
    """Return the way to a place from the nearest point of triangles (m, 3, 3)."""
    least, found = math.inf, (math.inf, 0.0, 0.0)
    for t in range(corners.shape[0]):
        a, b, c = row_of(corners, t, 0), row_of(corners, t, 1), row_of(corners, t, 2)
        away = subtract(place, combine(closest_on_triangle(place, a, b, c), a, b, c))
        squared = away[0] ** 2 + away[1] ** 2 + away[2] ** 2
        if squared < least:
            least, found = squared, away
    return found
