"""Verification tables of the catheter: elastica, circle, buckling, catenary, vibration, torsion."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipk
from verification_table import Entry, Table

from trocar.services.mechanics.rod.implicit import SPECTRAL_RADIUS
from trocar.studies.published import rod_dynamics as dynamics
from trocar.studies.published import rods as problems

ELASTICA = {  # P L^2/EI: tip angle [rad], deflection w/L, shortening u/L
    0.5: (0.24453, 0.16214, 0.01592),
    2.0: (0.78175, 0.49346, 0.16064),
    5.0: (1.21537, 0.71379, 0.38763),
    10.0: (1.43029, 0.81061, 0.55500),
}
BISSHOPP = "Bisshopp-Drucker, Mattiasson (computed to 1e-5)"
CLOSED_FORM = "closed form"


def tables() -> list[Table]:
    return [elastica(), circle_and_catenary(), buckling(), vibration(), convergence_in_time(), spinning(), torsion()]


def segments(n: int) -> str:
    return f"{n} segments"


def elastica() -> Table:
    entries = []
    for load, reference in ELASTICA.items():
        for n in (25, 50):
            names = ("tip angle", "deflection w/L", "shortening u/L")
            for name, value, expected in zip(names, problems.elastica_tip(load, n), reference, strict=True):
                quantity = f"PL²/EI = {load:g}, {name}"
                entries.append(Entry(quantity, segments(n), value, expected, BISSHOPP))
    return Table(
        "Catheter, large deflection under a tip load",
        "A clamped rod under a tip load that keeps its direction, settled by the implicit step at 2 ms. The error "
        "falls with the square of the segment length.",
        sorted(entries, key=lambda e: float(e.quantity.split()[2].rstrip(","))),
    )


def circle_and_catenary() -> Table:
    _, curvature = problems.end_moment()
    state, tension_n = problems.hanging_chain()
    a = brentq(lambda a: 2.0 * a * np.sinh(0.05 / a) - 0.15, 0.01, 1.0)
    weight = 9.81 * problems.LINE_DENSITY
    sag = a * (np.cosh(0.05 / a) - 1.0)
    return Table(
        "Catheter, end moment and catenary",
        "M = 2πEI/L bends the rod to a circle; bending springs in the angle reproduce uniform curvature exactly. The"
        " chain (EI = 0, span 100 mm, length 150 mm) hangs by its ends; its end tension is measured in the middle of"
        " the first segment.",
        [
            Entry("end moment, curvature L/2π, mean", segments(50), float(curvature.mean()), 1.0, CLOSED_FORM),
            Entry("end moment, curvature L/2π, tip", segments(50), float(curvature[-1]), 1.0, CLOSED_FORM),
            Entry("catenary, sag", segments(50), -float(state.position_m[:, 2].min()), sag, CLOSED_FORM, "m"),
            Entry(
                "catenary, end tension",
                segments(50),
                tension_n,
                float(np.hypot(weight * a, weight * 0.5 * 0.15 * 49 / 50)),
                CLOSED_FORM,
                "N",
            ),
        ],
    )


def buckling() -> Table:
    entries = [
        Entry(
            f"Euler load, {ends}",
            segments(50),
            problems.thrust_after_buckling_n(ends),
            problems.euler_load_n(ends),
            CLOSED_FORM,
            "N",
        )
        for ends in problems.EULER_FACTOR
    ]
    for degrees in (40.0, 90.0):
        ratio = (2.0 * ellipk(np.sin(np.radians(degrees) / 2.0) ** 2) / np.pi) ** 2
        angle = float(np.degrees(problems.buckled_tip_angle(ratio)))
        name = f"tip angle at P/P_cr = {ratio:.4f}"
        entries.append(Entry(name, segments(50), angle, degrees, "elliptic integral", "°"))
    entries.append(
        Entry(
            "twist buckling, clamped ends, ML/EI",
            segments(50),
            problems.critical_torque_factor(),
            8.9868,
            "tan x = x, x = ML/2EI",
        )
    )
    return Table(
        "Catheter, buckling",
        "The Euler load is the thrust of a column whose ends approach by 0.02 % more than it compresses. The tip "
        "angle is that of a clamped-free column. Greenhill's 2π for hinged ends is left out: this rod has no hinge "
        "whose axial moment keeps its direction.",
        entries,
    )


def vibration() -> Table:
    entries = [
        Entry(
            f"cantilever mode {mode + 1}",
            segments(n),
            problems.measured_frequency_rad_s(mode, n) / (2 * np.pi),
            problems.mode_frequency_rad_s(mode) / (2 * np.pi),
            "Euler-Bernoulli",
            "Hz",
        )
        for mode in range(3)
        for n in (25, 50)
    ]
    return Table(
        "Catheter, vibration",
        "The rod is released in the shape of a mode and timed by zero crossings. Undamped midpoint rule (spectral "
        "radius 1), 400 steps a period.",
        entries,
    )


def convergence_in_time() -> Table:
    steps_s = (1e-3, 5e-4, 2.5e-4)
    errors_m = dynamics.tip_errors_m(steps_s, SPECTRAL_RADIUS)
    entries = [
        Entry(
            f"order from {1e3 * coarse:g} to {1e3 * fine:g} ms, tip error {1e3 * error:.2g} to {1e3 * finer:.2g} mm",
            segments(50),
            float(np.log2(error / finer)),
            2.0,
            "second order",
        )
        for coarse, fine, error, finer in zip(steps_s[:-1], steps_s[1:], errors_m[:-1], errors_m[1:], strict=True)
    ]
    return Table(
        "Catheter, convergence in the time step",
        "A cantilever bent by 17 mm is released at rest, with the scenes' material damping and the default spectral "
        "radius. The error is the root mean square distance of the tip over 0.3 s from the midpoint rule at 10 us.",
        entries,
    )


def spinning() -> Table:
    entries = [
        Entry(
            f"angular momentum after 0.5 s at {rate:g} rad/s",
            segments(50),
            dynamics.spin(rate, rho).momentum,
            1.0,
            f"conserved; spectral radius {rho:g}",
        )
        for rate in (20.0, 100.0)
        for rho in (1.0, 0.8, SPECTRAL_RADIUS)
        if (rate, rho) != (100.0, 1.0)
    ]
    return Table(
        "Catheter, free rotation",
        "A straight, free, undamped rod spins across its axis in steps of 1 ms. The number is its angular momentum "
        "over that at the start.",
        entries,
    )


def torsion() -> Table:
    reference = problems.GJ * 2.0 / problems.LENGTH_M
    return Table(
        "Catheter, torsion",
        "T = GJ φ/L, both ends clamped.",
        [Entry("torque at φ = 2 rad", segments(50), problems.torque_n_m(2.0), reference, CLOSED_FORM, "N m")],
    )
