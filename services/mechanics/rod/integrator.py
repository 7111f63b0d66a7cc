"""The interface of rod integrators, and the integrators by their names in scenes."""

from __future__ import annotations

from typing import Protocol

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.rod.implicit import SPECTRAL_RADIUS, ImplicitIntegrator
from services.mechanics.rod.model import RodModel
from services.mechanics.rod.properties import RodProperties
from services.mechanics.rod.semi_implicit import SemiImplicitIntegrator
from services.mechanics.rod.state import RodState
from services.mechanics.rod.supports import Supports
from services.mechanics.rod.twist import TwistModel


class RodIntegrator(Protocol):
    """A step in two halves, with the contacts solved in between.

    `predict` ends the step under the given forces alone; `compliance` or `solve` give the response of its end to
    contact forces: dx = position_gain_s2 A^-1 f, dv = velocity_gain_s A^-1 f; `correct` applies them.
    """

    properties: RodProperties
    model: RodModel
    twist: TwistModel | None
    held_target_m: FloatArray

    @property
    def held(self) -> IntArray: ...  # noqa: D102 - the implementations say it
    @property
    def position_gain_s2(self) -> float: ...  # noqa: D102
    @property
    def velocity_gain_s(self) -> float: ...  # noqa: D102
    def predict(self, state: RodState, external_force_n: FloatArray, dt_s: float) -> None: ...  # noqa: D102
    def solve(self, force_n: FloatArray, out: FloatArray) -> None: ...  # noqa: D102
    def compliance(self, particles: IntArray, out: FloatArray) -> None: ...  # noqa: D102
    def correct(self, state: RodState, contact_force_n: FloatArray) -> None: ...  # noqa: D102


def build_integrator(
    name: str, properties: RodProperties, supports: Supports | None = None, spectral_radius: float = SPECTRAL_RADIUS
) -> RodIntegrator:
    """Return the integrator "implicit" with this numerical damping, or "semi_implicit", which has none.

    Raises ValueError if there is none of this name, or the spectral radius is not within 0 and 1.
    """
    if name == "implicit":
        return ImplicitIntegrator(properties, supports, spectral_radius=spectral_radius)
    if name == "semi_implicit":
        return SemiImplicitIntegrator(properties, supports)
    raise ValueError(f"unknown rod integrator {name!r}; known: implicit, semi_implicit")
