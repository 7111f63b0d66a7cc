"""The interface of rod integrators, and their construction by the names that scenes use."""

from __future__ import annotations

from typing import Protocol

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.rod.implicit import SPECTRAL_RADIUS, ImplicitIntegrator
from trocar.services.mechanics.rod.model import RodModel
from trocar.services.mechanics.rod.properties import RodProperties
from trocar.services.mechanics.rod.semi_implicit import SemiImplicitIntegrator
from trocar.services.mechanics.rod.state import RodState
from trocar.services.mechanics.rod.supports import Supports
from trocar.services.mechanics.rod.twist import TwistModel


class RodIntegrator(Protocol):
    """A predictor-corrector step, with the contacts solved between predictor and corrector.

    `predict` takes the step with the given forces alone. `compliance` and `solve` return the response of its end to
    contact forces, dx = position_gain_s2 A^-1 f and dv = velocity_gain_s A^-1 f. `correct` applies contact forces.
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

    Raises ValueError if the name is unknown, or the spectral radius is not within 0 and 1.
    """
    if name == "implicit":
        return ImplicitIntegrator(properties, supports, spectral_radius=spectral_radius)
    if name == "semi_implicit":
        return SemiImplicitIntegrator(properties, supports)
    raise ValueError(f"unknown rod integrator {name!r}; known: implicit, semi_implicit")
