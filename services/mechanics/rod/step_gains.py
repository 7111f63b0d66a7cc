"""The base class of rod integrators: held particles, and the gains of the step's response to contact forces."""

from __future__ import annotations

from trocar.services.mechanics.arrays import IntArray
from trocar.services.mechanics.rod.model import RodModel


class StepGains:
    """Base class of the integrators. They write ``model`` and, in `predict`, ``_dt_s``; A is their matrix."""

    model: RodModel
    _dt_s: float

    @property
    def held(self) -> IntArray:
        """(h,) held particles; row k of ``held_target_m`` is the position of held[k] at a step's end (NaN: stay)."""
        return self.model.held

    @property
    def position_gain_s2(self) -> float:
        """Factor of A^-1 f in the position change of the step: dt^2."""
        return self._dt_s**2

    @property
    def velocity_gain_s(self) -> float:
        """Factor of A^-1 f in the velocity change of the step: dt."""
        return self._dt_s
