"""A catheter on a slope that is tilted slowly: at which slope it begins to slide, and how much friction acts then.

A catheter lies along the bottom of a straight duct and nothing else touches it. Gravity turns about it so slowly that
forces are those of rest. By Coulomb's law it begins to slide where the slope is the static coefficient, however many
contacts bear it and whatever the wall, and it is then accelerated by what the kinetic coefficient leaves of its weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scene import CatheterScene, DuctScene, SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct

G_M_S2 = 9.81
SETTLES_S = 0.3
RISE_1_S = 0.02
"""By which the slope grows: within 20 ms by less than half a per cent of the smallest coefficient."""
BEGINS_BELOW = 0.85
"""Of the kinetic coefficient: from there on the slope grows slowly, and nothing may move."""
RESTS_M_S, SLID_M = 1e-4, 0.5e-3
"""A catheter that has come so far slides; it began to when it was last slower than this."""
RUN_M = 0.3e-3, 2e-3
"""Between these ways the acceleration is measured."""
N_AROUND = 24
DOWN = np.array([0.0, -math.sin(math.pi / N_AROUND), -math.cos(math.pi / N_AROUND)])
"""Across a facet of the wall: in the groove between two of them it would press harder than the catheter weighs."""
RADIUS_M, THICKNESS_M, LENGTH_M, BODY_M = 4e-3, 0.5e-3, 40e-3, 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Incline:
    """A catheter on a slope.

    Attributes:
        length_m: float. Of the catheter.
        n_segments: int. Of the catheter; each touches the wall once or more.
        youngs_modulus_pa: float. Of the wall.
        dt_s: float. Length of a step.
        mu: (static, kinetic) coefficients.
        tolerance_n: float. Of the contact solve.
    """

    length_m: float = 24e-3
    n_segments: int = 20
    youngs_modulus_pa: float = 300e3
    dt_s: float = 1e-3
    mu: tuple[float, float] = (0.3, 0.2)
    tolerance_n: float = 1e-8


@dataclass(frozen=True, slots=True)
class Slid:
    """What a catheter did on its slope.

    Attributes:
        onset: float. Slope at which it began to slide; infinite if it never did.
        sliding: float. Coefficient that acted while it slid; not a number if it was not seen to slide.
        contacts: float. How many contacts bore it, on an average, before it slid.
        crept_m: float. How far it had moved until then.
    """

    onset: float
    sliding: float
    contacts: float
    crept_m: float


def slide(incline: Incline) -> Slid:
    """Tilt a slope until the catheter slides, and hold it there; once to either side.

    A soft wall sinks under the catheter, and more towards its open end: this slope of its own counts once to either
    side, so the mean of both is without it.
    """
    both = [_slide_to(incline, side) for side in (1.0, -1.0)]
    onset, sliding, contacts, _ = (float(np.mean([getattr(slid, each.name) for slid in both])) for each in fields(Slid))
    return Slid(onset, sliding, contacts, max(slid.crept_m for slid in both))


def _slide_to(incline: Incline, side: float) -> Slid:
    run = _Run(incline, side)
    run.settle()
    return run.tilt()


def incline_scene(incline: Incline) -> SceneModel:
    """Return the scene: a catheter without drag in the bottom of a duct."""
    x_m, away_m = 0.5 * (LENGTH_M - incline.length_m), RADIUS_M * DOWN[2] + 0.5 * (THICKNESS_M + BODY_M)
    _, y_m, z_m = away_m / DOWN[2] * DOWN
    scene = SceneModel(
        duct=DuctScene(
            radius_m=RADIUS_M,
            thickness_m=THICKNESS_M,
            length_m=LENGTH_M,
            youngs_modulus_pa=incline.youngs_modulus_pa,
            n_around=N_AROUND,
            n_modes=80,
        ),
        catheter=CatheterScene(
            anchor="free",
            length_m=incline.length_m,
            n_segments=incline.n_segments,
            outer_diameter_m=BODY_M,
            inner_diameter_m=0.5e-3,
            tip_position_m=(x_m, y_m, z_m),
            viscous_drag_n_s_m2=0.0,
        ),
        forceps=(),
        effects={"gravity": GravitySettings(), "friction": FrictionSettings(*incline.mu)},
    )
    return replace(scene, contact=replace(scene.contact, tolerance_n=incline.tolerance_n))


class _Run:
    def __init__(self, incline: Incline, side: float) -> None:
        scene = incline_scene(incline)
        self._simulation = Simulation(scene, build_scene_duct(scene, cache_directory() / "bases"))
        self._incline, self._side, self._tools = incline, side, ToolInputs()
        self._tools.present[:] = False
        catheter = self._simulation.catheter
        self._mass_kg = catheter.properties.particle_mass_kg()[:, None]

    def settle(self) -> None:
        """Let it come to rest on level ground, and turn that to where the slow rise begins."""
        steps = round(SETTLES_S / self._incline.dt_s)
        begin = BEGINS_BELOW * self._incline.mu[1]
        for slope in (*np.zeros(steps), *np.linspace(0.0, begin, steps), *np.full(steps // 2, begin)):
            self._step(float(slope))

    def tilt(self) -> Slid:
        """Raise the slope until it slides, then measure the acceleration."""
        dt_s, slope, contacts = self._incline.dt_s, BEGINS_BELOW * self._incline.mu[1], []
        start_m, began = self._along_m(), (slope, 0.0)
        while self._along_m() - start_m < SLID_M:
            slope += RISE_1_S * dt_s
            self._step(slope)
            contacts.append(self._n_pressed())
            if self._speed_m_s() < RESTS_M_S:
                began = slope, self._along_m() - start_m
            if slope > 2.0 * self._incline.mu[0]:
                return Slid(math.inf, math.nan, float(np.mean(contacts)), abs(began[1]))
        return Slid(began[0], self._sliding(slope), float(np.mean(contacts)), abs(began[1]))

    def _sliding(self, slope: float) -> float:
        """Return the coefficient that acts, from the acceleration between two ways."""
        dt_s, start_m, seen = self._incline.dt_s, self._along_m(), []
        for _ in range(round(1.0 / dt_s)):
            self._step(slope)
            way_m = self._along_m() - start_m
            if way_m > RUN_M[0]:
                seen.append(self._speed_m_s())
            if way_m > RUN_M[1]:
                break
        else:
            return math.nan
        rate_m_s2 = (seen[-1] - seen[0]) / (dt_s * (len(seen) - 1))
        return slope - rate_m_s2 * math.hypot(1.0, slope) / G_M_S2

    def _step(self, slope: float) -> None:
        gravity_m_s2 = G_M_S2 * (DOWN + np.array([self._side * slope, 0.0, 0.0])) / math.hypot(1.0, slope)
        weight_n: FloatArray = self._mass_kg * gravity_m_s2
        self._simulation.catheter.constant_force_n[:] = weight_n
        self._simulation.step(self._tools, self._incline.dt_s)

    def _n_pressed(self) -> int:
        rows = self._simulation.contacts
        return int((rows.force_n[: rows.n_contacts, 0] > 0.0).sum())

    def _along_m(self) -> float:
        return self._side * float(self._simulation.catheter.state.position_m[:, 0].mean())

    def _speed_m_s(self) -> float:
        return self._side * float(self._simulation.catheter.state.velocity_m_s[:, 0].mean())
