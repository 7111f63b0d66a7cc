"""Velocity from position differences, by a second-order Butterworth low-pass, for simulated and real arms."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel


def butterworth(cut_off_hz: float, period_s: float = 1e-3) -> FloatArray:
    """Return b0, b1, b2, a1, a2 of a second-order low-pass at the rate of the ticks, by the bilinear transform.

    The result is that of `scipy.signal.butter`, whose import would take half a second of a start.
    """
    coefficients = np.zeros(5)
    design(cut_off_hz, period_s, coefficients)
    return coefficients


@kernel
def design(cut_off_hz: float, period_s: float, out: FloatArray) -> None:
    """Write the coefficients of `butterworth` into `out`, (5,); the cut-off is limited to just below half the rate."""
    k = math.tan(math.pi * min(cut_off_hz * period_s, 0.49))
    scale = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    out[0] = out[2] = k * k * scale
    out[1] = 2.0 * out[0]
    out[3] = 2.0 * (k * k - 1.0) * scale
    out[4] = (1.0 - math.sqrt(2.0) * k + k * k) * scale


@kernel
def low_pass(raw: float, state: FloatArray, axis: int, coefficients: FloatArray) -> float:
    """Return the filtered value of `raw`; `state` (2, n) is the state of the filter of `axis`."""
    b0, b1, b2, a1, a2 = coefficients[0], coefficients[1], coefficients[2], coefficients[3], coefficients[4]
    value = b0 * raw + state[0, axis]
    state[0, axis] = b1 * raw - a1 * value + state[1, axis]
    state[1, axis] = b2 * raw - a2 * value
    return float(value)
