"""How sure a rate is that was counted: its interval of 95 % confidence."""

from __future__ import annotations

from scipy.stats import beta

_BEYOND = 0.025
"""Of the probability, on either side of 95 %."""


def interval(failed: int, cases: int) -> tuple[float, float]:
    """Return the interval of a rate, after Clopper and Pearson, Biometrika 26 (1934) 404: it holds at any rate."""
    low = float(beta.ppf(_BEYOND, failed, cases - failed + 1)) if failed else 0.0
    high = float(beta.ppf(1.0 - _BEYOND, failed + 1, cases - failed)) if failed < cases else 1.0
    return low, high


def rate(failed: int, cases: int) -> str:
    """The interval of a rate, in per cent."""
    low, high = interval(failed, cases)
    return f"{100 * low:.3g} to {100 * high:.3g} %"
