"""What rod integrators share: who is held, and what a contact force changes by the length of the step."""

from __future__ import annotations

from services.mechanics.arrays import IntArray
from services.mechanics.rod.model import RodModel


class StepGains:
    """Base of the integrators, which write ``model`` and, in `predict`, ``_dt_s``; A is their matrix."""

    model: RodModel
    _dt_s: float

    @property
    def held(self) -> IntArray:
        """(h,) held particles; row k of ``held_target_m`` says where held[k] shall be when a step ends (NaN: stay)."""
        return self.model.held

    @property
    def position_gain_s2(self) -> float:
        """What A^-1 f is multiplied with to give the position change of the step: dt^2."""
        return self._dt_s**2

    @property
    def velocity_gain_s(self) -> float:
        """What A^-1 f is multiplied with to give the velocity change of the step: dt."""
        return self._dt_s
