"""Measures of motion: each of a path or a speed sampled at a fixed rate, each with a closed form in the tests."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

Values = NDArray[np.float64]
Measure = Callable[[Values, float], float]

SAMPLE_HZ = 50.0  # five times the cut-off, by which nothing below it is lost
CUT_OFF_HZ = 10.0  # as usual in the field: voluntary motion lies below, tremor and noise above
MOVES_M_S, IDLE_M_S = 5e-3, 2e-3  # assumptions: a tremor of 0.1 mm at 8 Hz has 5 mm/s
_SHORTEST_S = 2.0 / CUT_OFF_HZ
"""A shorter movement has no shape to judge: a speed rises and falls in two periods of the cut-off at least."""
_SPARC_HZ, _SPARC_THRESHOLD, _SPARC_PAD = 10.0, 0.05, 4  # as published by Balasubramanian et al. (2015)


def resampled(time_s: Values, values: Values, rate_hz: float = SAMPLE_HZ) -> Values:
    """Return values (n,) or (n, k) at growing times (n,) filtered and then sampled at a fixed rate.

    A zero-phase Butterworth of second order at 10 Hz comes first: noise and quantisation of a position would
    otherwise be counted as way (1479 mm at 1 kHz with 0.02 mm of noise read 3066 mm).
    """
    values = values.reshape(len(values), -1)
    if len(time_s) < 2:
        return values
    step_s = float(np.median(np.diff(time_s)))
    even_s = time_s[0] + step_s * np.arange(math.floor((time_s[-1] - time_s[0]) / step_s + 1e-6) + 1)
    even = _at(even_s, time_s, values)
    sections = butter(2, min(CUT_OFF_HZ * step_s * 2.0, 0.99), output="sos")
    padding = min(3 * round(1.0 / (CUT_OFF_HZ * step_s)), len(even) - 1)
    smooth = sosfiltfilt(sections, even, axis=0, padlen=padding)
    wanted_s = time_s[0] + np.arange(math.floor((even_s[-1] - time_s[0]) * rate_hz + 1e-6) + 1) / rate_hz
    return _at(wanted_s, even_s, smooth)


def _at(wanted_s: Values, time_s: Values, values: Values) -> Values:
    return np.column_stack([np.interp(wanted_s, time_s, column) for column in values.T])


def path_length(path_m: Values) -> float:
    """Return the sum of |dp| of a path (n, 3)."""
    return float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())


def depth_length(path_m: Values, axes: Values) -> float:
    """Return the way along the tool: the sum of |dp . axis| with unit axes (n, 3)."""
    steps = np.diff(path_m, axis=0)
    return float(np.abs(np.einsum("ij,ij->i", steps, 0.5 * (axes[1:] + axes[:-1]))).sum())


def speed(path_m: Values, rate_hz: float = SAMPLE_HZ) -> Values:
    """Return the speed (n,) of a path (n, 3) by central differences."""
    if len(path_m) < 2:
        return np.zeros(len(path_m))
    velocity: Values = np.linalg.norm(np.gradient(path_m, 1.0 / rate_hz, axis=0), axis=1)
    return velocity


def movements(speed_m_s: Values, rate_hz: float = SAMPLE_HZ) -> list[slice]:
    """Return the stretches that move, from rest to rest: faster than `MOVES_M_S`, to where it is below `IDLE_M_S`."""
    found: list[slice] = []
    at, n = 0, len(speed_m_s)
    moving, resting = speed_m_s > MOVES_M_S, speed_m_s < IDLE_M_S
    while at < n and moving[at:].any():
        first = at + int(np.argmax(moving[at:]))
        begin = first
        while begin > at and not resting[begin]:
            begin -= 1
        rests = resting[first:]
        end = first + int(np.argmax(rests)) + 1 if rests.any() else n
        if (end - begin) / rate_hz >= _SHORTEST_S:
            found.append(slice(begin, end))
        at = end
    return found


def sparc(speed_m_s: Values, rate_hz: float = SAMPLE_HZ) -> float:
    """Return the spectral arc length of a movement's speed; closer to 0 is smoother, least jerk gives -1.40.

    Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet 2015, 10.1186/s12984-015-0090-9: cut-off 10 Hz,
    threshold 0.05, zero padding by 4 doublings.
    """
    n = 2 ** (math.ceil(math.log2(len(speed_m_s))) + _SPARC_PAD)
    frequency = np.arange(n) * rate_hz / n
    size = np.abs(np.fft.fft(speed_m_s, n))
    size = size / size.max()
    below = frequency <= _SPARC_HZ
    frequency, size = frequency[below], size[below]
    above = np.flatnonzero(size >= _SPARC_THRESHOLD)
    part = slice(above[0], above[-1] + 1)
    frequency, size = frequency[part], size[part]
    if len(frequency) < 2:
        return 0.0
    return -float(np.hypot(np.diff(frequency) / (frequency[-1] - frequency[0]), np.diff(size)).sum())


def log_dimensionless_jerk(speed_m_s: Values, rate_hz: float = SAMPLE_HZ) -> float:
    """Return -ln(T^3 / v_peak^2 * integral of (d2v/dt2)^2 dt); least jerk gives -ln 204.8 = -5.322."""
    time_s = np.arange(len(speed_m_s)) / rate_hz
    bend = CubicSpline(time_s, speed_m_s)(time_s, 2)  # linear between: its square is integrated exactly
    integral = float((bend[1:] ** 2 + bend[1:] * bend[:-1] + bend[:-1] ** 2).sum()) / (3.0 * rate_hz)
    return -math.log(max(float(time_s[-1]) ** 3 / float(speed_m_s.max()) ** 2 * integral, 1e-300))


def motion_frequency(speed_m_s: Values, rate_hz: float = SAMPLE_HZ, share: float = 0.95) -> float:
    """Return the frequency below which 95 % of the power of a speed's changes lies, in Hz."""
    power = np.abs(np.fft.rfft(speed_m_s - speed_m_s.mean())) ** 2
    total = np.cumsum(power)
    if total[-1] <= 0.0:
        return 0.0
    return float(np.searchsorted(total, share * total[-1])) * rate_hz / len(speed_m_s)


def over_movements(measure: Measure, speed_m_s: Values, rate_hz: float = SAMPLE_HZ) -> float | None:
    """Return the mean of a measure over the movements, each by its length; None without any."""
    parts = movements(speed_m_s, rate_hz)
    if not parts:
        return None
    weights = [part.stop - part.start for part in parts]
    return float(np.average([measure(speed_m_s[part], rate_hz) for part in parts], weights=weights))
