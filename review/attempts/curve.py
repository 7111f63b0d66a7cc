"""Over a trainee's attempts: the learning curve, and CUSUM, which tells when a failure rate has become acceptable."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.optimize import least_squares

from trocar.review.attempts.motion import Values
from trocar.services.training.score import CusumRates

_FEWEST = 5  # two more than the numbers of the curve, as each has an error, too


class Cusum(msgspec.Struct, frozen=True, kw_only=True):
    """The chart after each attempt; above `alarm` the unacceptable rate is held for true, below `clear` the other."""

    values: list[float]
    step: float
    alarm: float
    clear: float


def cusum(failed: Sequence[bool], rates: CusumRates) -> Cusum:
    """Return the chart of attempts that failed or not: a failure adds 1 - s, a success takes s off.

    It is the sequential probability ratio test of two failure rates, in units of what one failure adds more than a
    success (Bolsin and Colson 2000, 10.1093/intqhc/12.5.433). The chart drifts to neither side at a failure rate of s.
    """
    p, q = rates.acceptable, rates.unacceptable
    failure, success = math.log(q / p), math.log((1.0 - p) / (1.0 - q))
    unit = failure + success
    step = success / unit
    values = np.cumsum([1.0 - step if each else -step for each in failed]) if failed else np.zeros(0)
    return Cusum(
        values=values.tolist(),
        step=step,
        alarm=math.log((1.0 - rates.missed_alarm) / rates.false_alarm) / unit,
        clear=-math.log((1.0 - rates.false_alarm) / rates.missed_alarm) / unit,
    )


class Learning(msgspec.Struct, frozen=True, kw_only=True):
    """``plateau + gain n ** -rate`` fitted to attempts n = 1, 2, ...; `values` are the fit."""

    plateau: float
    gain: float
    rate: float
    values: list[float]


def learning_curve(values: Sequence[float]) -> Learning | None:
    """Return the power law of practice that fits best; None of fewer than five attempts, or of equal ones."""
    seen = np.array(values, float)
    if len(seen) < _FEWEST or float(np.ptp(seen)) == 0.0:
        return None
    n = np.arange(1.0, len(seen) + 1.0)

    def misfit(x: Values) -> Values:
        away: Values = _power_law(n, x[0], x[1], x[2]) - seen
        return away

    found = least_squares(
        misfit,
        (seen[-1], seen[0] - seen[-1], 0.5),
        bounds=([-np.inf, -np.inf, 0.05], [np.inf, np.inf, 5.0]),
        x_scale=(max(abs(seen).max(), 1e-9), float(np.ptp(seen)), 1.0),
    )
    plateau, gain, rate = found.x.tolist()
    return Learning(plateau=plateau, gain=gain, rate=rate, values=_power_law(n, plateau, gain, rate).tolist())


def _power_law(n: Values, plateau: float, gain: float, rate: float) -> Values:
    values: Values = plateau + gain * n**-rate
    return values
