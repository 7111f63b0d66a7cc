"""Coefficients of an implicit step: generalized-alpha, or implicit Euler.

The generalized-alpha method of Chung and Hulbert (1993) is written as a midpoint rule. With p the bilinear transform of
dt/2 d/dt and e = (1 - rho)/(1 + rho), rho the spectral radius at infinite frequency, that method answers stiffness K
and damping C with

    M dv/dt + K (1 + e p)^3/(1 + 3 e p) x + C (1 + 2 e^2 p^2/(1 + 3 e p)) v = f

where the midpoint rule (e = 0) has K x + C v. So it differs from that rule only by a displacement that is added to the
particles when strains are taken, their *lead*, and by a similar lead of the velocity. Both follow from a filtered
velocity w, dw/dt = (v - w)/(3 e dt/2), which is the only additional state. So, unlike the usual form with
accelerations, it keeps two properties of the midpoint rule under large rotations: the directions of internal forces
conserve angular momentum, and the work of the stretch forces is the change of the stretch energy.
"""

from __future__ import annotations

from typing import NamedTuple

from trocar.services.mechanics.compiled import inlined_kernel, kernel


class StepForm(NamedTuple):
    """A step from (x, v, w) with velocity change dv and mean velocity u = v + ``mean`` dv, which ends at x + dt u.

    Forces are taken at x + ``at`` dt u. Strains are taken with the additional lead dt (``lead_change`` dv +
    ``lead_lag`` (u - w)), damping at the velocity u + ``speed_change`` dv + ``speed_lag`` (u - w). In the step w
    changes by ``follow`` (u - w).
    """

    dt_s: float
    mean: float
    at: float
    lead_change: float
    lead_lag: float
    speed_change: float
    speed_lag: float
    follow: float


@inlined_kernel
def generalized_alpha(dt_s: float, rho: float) -> StepForm:
    """Return the second-order step of spectral radius rho."""
    e = (1.0 - rho) / (1.0 + rho)
    slow = 1.0 / (1.0 + 3.0 * e)
    follow = 2.0 * slow if e > 0.0 else 1.0
    return StepForm(dt_s, 0.5, 0.5, e * e / 12.0, 4.0 / 3.0 * e * e * slow, e / 3.0, -2.0 / 3.0 * e * slow, follow)


@kernel
def implicit_euler(dt_s: float) -> StepForm:
    """Return the first-order step, which never raises the energy."""
    return StepForm(dt_s, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@inlined_kernel
def stiffness_scale(form: StepForm) -> float:
    """Return the factor of the stiffness in the step's matrix: dt times the derivative of a strain by dv."""
    return float(form.dt_s * form.dt_s * (form.mean * (form.at + form.lead_lag) + form.lead_change))


@inlined_kernel
def damping_scale(form: StepForm) -> float:
    """Return the factor of the damping in the step's matrix: dt times the derivative of damping's velocity by dv."""
    return float(form.dt_s * (form.mean * (1.0 + form.speed_lag) + form.speed_change))
