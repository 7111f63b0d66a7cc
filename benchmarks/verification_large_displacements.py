"""Verification tables of shells at large displacements, under the whole load.

benchmarks/results/published-shells.md compares all points of the published paths.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from verification_table import Entry, Table

from trocar.services.mechanics.fem.nonlinear import PathSettings, trace_path
from trocar.studies.fem.arc_length import trace_arc_length
from trocar.studies.published.large_displacements import (
    DIAPHRAGMS,
    HALF_CYLINDER,
    HEMISPHERE,
    PINCH,
    PULLED,
    ROOF_LIMITS,
    SHEAR,
    SLIT_PLATE,
    cantilever,
    closed_hemisphere,
    cylinder_between_diaphragms,
    force_over_linear,
    hemisphere,
    hinged_roof,
    pulled_cylinder,
    pushed_half_cylinder,
    slit_plate,
    squeezed_duct,
)

SZE = "Sze, Liu and Lo 2004"


def tables() -> list[Table]:
    entries = [
        *_cantilevers(),
        *_slit_plate(),
        *_hemisphere(),
        *_closed_hemisphere(),
        *_pulled_cylinder(),
        *_half_cylinder(),
        *_between_diaphragms(),
        *_roofs(),
        *_duct(),
    ]
    about = (
        "Corotational triangles, as `trocar fem` solves them with `analysis: nonlinear`. Displacements in the units "
        "of the source. All points of the published paths are compared on "
        "[another page](../../benchmarks/results/published-shells.md)."
    )
    return [Table("Shells at large displacements", about, entries)]


def _cantilevers() -> list[Entry]:
    entries = []
    for n in (8, 16, 32):
        problem = cantilever("shear", n)
        end = trace_path(problem.shell, problem.load, PathSettings(n_steps=4))[-1]
        deflection, shortening = SHEAR[end.part]
        tip = problem.moved(end)[0]
        entries.append(Entry("cantilever under 4, deflection", f"cst, {n} x 2", tip[2], deflection, SZE))
        entries.append(Entry("cantilever under 4, shortening", f"cst, {n} x 2", -tip[0], shortening, SZE))
    problem = cantilever("moment")
    end = trace_path(problem.shell, problem.load, PathSettings(n_steps=10))[-1]
    entries.append(
        Entry("strip bent to a circle, tip back by", "cst, 16 x 2", -problem.moved(end)[0, 0], 10.0, "closed form")
    )
    return sorted(entries, key=lambda entry: entry.quantity)


def _slit_plate() -> list[Entry]:
    entries = []
    for n_around, n_across in ((30, 4), (60, 8)):
        problem = slit_plate(n_around, n_across)
        end = trace_path(problem.shell, problem.load, PathSettings(n_steps=20))[-1]
        lifts, published = problem.moved(end)[:, 2], SLIT_PLATE[round(end.part, 6)]
        for name, lift, value in zip(("outer", "inner"), lifts, published, strict=True):
            quantity = f"slit annular plate, {name} corner"
            entries.append(Entry(quantity, f"andes, {n_around} x {n_across}", lift, value, SZE))
    return sorted(entries, key=lambda entry: entry.quantity)


def _hemisphere() -> list[Entry]:
    entries = []
    for n in (16, 32, 48):
        problem = hemisphere(n)
        pulled, pushed = problem.moved(trace_path(problem.shell, problem.load, PathSettings(n_steps=4))[-1])
        mesh = f"andes, {n} x {n} a quarter"
        entries.append(Entry("pinched hemisphere, outward", mesh, pulled[0], HEMISPHERE[0], f"{SZE} (unverified)"))
        entries.append(Entry("pinched hemisphere, inward", mesh, -pushed[1], HEMISPHERE[1], f"{SZE} (unverified)"))
    return sorted(entries, key=lambda entry: entry.quantity)


def _closed_hemisphere() -> list[Entry]:
    """Nobody's table of large displacements was at hand: those are compared with the finer mesh."""
    entries, full = [], []
    for n in (16, 32):
        problem, mesh = closed_hemisphere(n), f"andes, three of {n} x {n} a quarter"
        linear = problem.shell.model.solve_static(problem.load.dead).displacement_m[problem.watched[0], 0] / 200.0
        source = "Simo, Fox and Rifai 1989 (unverified)"
        entries.append(Entry("hemisphere without hole under unit forces, outward", mesh, linear, 0.0924, source))
        end = trace_path(problem.shell, problem.load, PathSettings(n_steps=4))[-1]
        full.append((problem.moved(end)[0, 0], -problem.moved(end)[1, 1]))
    for name, value, reference in zip(("outward", "inward"), *full, strict=True):
        quantity = f"pinched hemisphere without hole, {name}"
        entries.append(Entry(quantity, "andes, three of 16 x 16 a quarter", value, reference, "the same at 32 x 32"))
    return entries


def _pulled_cylinder() -> list[Entry]:
    entries = []
    for n_around, n_along in ((12, 18), (16, 24)):
        problem = pulled_cylinder(n_around, n_along)
        end = trace_path(problem.shell, problem.load, PathSettings(n_steps=4))[-1]
        moved = problem.moved(end)
        for name, value, published in zip(
            ("at the force, outward", "beside it, inward", "open end, inward"),
            (moved[0, 2], -moved[1, 0], -moved[2, 0]),
            PULLED[round(end.part, 6)],
            strict=True,
        ):
            quantity = f"cylinder pulled apart, {name}"
            entries.append(Entry(quantity, f"andes, {n_around} x {n_along} an eighth", value, published, SZE))
    return sorted(entries, key=lambda entry: entry.quantity)


def _half_cylinder() -> list[Entry]:
    entries = []
    for n in (12, 16, 24):
        problem = pushed_half_cylinder(n, n)
        end = trace_path(problem.shell, problem.load, PathSettings(n_steps=10))[-1]
        value, published = -problem.moved(end)[0, 2], HALF_CYLINDER[end.part]
        entries.append(Entry("half cylinder pushed at its free end", f"andes, {n} x {n} a half", value, published, SZE))
    return entries


def _between_diaphragms() -> list[Entry]:
    """Up to a tenth of the load; beyond, 24 x 24 triangles snap from fold to fold, and only arc length goes on."""
    entries = []
    for n in (16, 24, 32):
        problem = cylinder_between_diaphragms(n, n)
        load = replace(problem.load, dead=0.1 * problem.load.dead)
        end = trace_path(problem.shell, load, PathSettings(n_steps=4))[-1]
        quantity = "cylinder between diaphragms at 0.1 of its load, at the force"
        moved = -problem.moved(end)[0, 2]
        entries.append(Entry(quantity, f"andes, {n} x {n} an eighth", moved, DIAPHRAGMS[0.1][0], SZE))
    return entries


def _roofs() -> list[Entry]:
    entries = []
    for thickness, (published, _) in ROOF_LIMITS.items():
        quantity = f"hinged roof, thickness {thickness}"
        coarse, fine = _extremes(thickness, 8), _extremes(thickness, 16)
        for n, limit in ((8, coarse[0]), (16, fine[0])):
            entries.append(Entry(f"{quantity}, limit load", f"andes, {n} x {n} a quarter", limit, 3e3 * published, SZE))
        lowest = f"{quantity}, lowest load"
        entries.append(Entry(lowest, "andes, 8 x 8 a quarter", coarse[1], fine[1], "the same at 16 x 16"))
    return entries


def _extremes(thickness: float, n: int) -> tuple[float, float]:
    """Load at which the roof snaps, and the lowest after it; of the parabola through the three points nearest."""
    problem = hinged_roof(thickness, n)
    path = trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=20))
    load = 3000.0 * np.array([point.part for point in path])
    top = int(np.flatnonzero(np.diff(load) < 0.0)[0])
    bottom = top + int(load[top:].argmin())
    return _vertex(load[top - 1 : top + 2]), _vertex(load[bottom - 1 : bottom + 2])


def _vertex(three: np.ndarray) -> float:
    bend, slope = 0.5 * (three[0] - 2.0 * three[1] + three[2]), 0.5 * (three[2] - three[0])
    return float(three[1] - slope**2 / (4.0 * bend))


def _duct() -> list[Entry]:
    entries = []
    for n_around, n_along in ((16, 24), (24, 36), (32, 48)):
        problem = squeezed_duct(n_around, n_along)
        ratio = force_over_linear(problem, trace_path(problem.shell, problem.load, PathSettings(n_steps=10)))
        for part, published in PINCH.items():
            quantity = f"duct squeezed by {50 * part:.0f} %, force over linear force"
            entries.append(Entry(quantity, f"andes, {n_around} x {n_along}", ratio[part], published, "CalculiX S8R"))
    return sorted(entries, key=lambda entry: entry.quantity)
