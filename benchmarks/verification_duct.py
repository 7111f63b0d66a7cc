"""Verification tables of the shell: published statics and frequencies, the reference duct, an independent solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from verification_table import Entry, Table

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ElementChoice, compute_modes
from trocar.studies.published import opensees as opensees_check
from trocar.studies.published import shells as problems

CST, ANDES = ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")
MACNEAL = "MacNeal-Harder"
TIMOSHENKO = "Timoshenko, plates"


def tables() -> list[Table]:
    made = [statics(), beams(), plates(), plate_frequencies()]
    made += [reference_duct(), droop(), tocher_triangle()]
    try:
        opensees_check.load_opensees()
    except ImportError as error:
        print(f"left out the independent solver: {error}")
        return made
    return [*made, independent_solver()]


def label(elements: ElementChoice) -> str:
    return f"{elements.membrane} + {elements.bending}"


def statics() -> Table:
    entries = []
    for elements in (CST, ANDES):
        for n in (8, 16, 32, 64):
            mesh = f"{label(elements)}, {n} a side"
            roof, cylinder = problems.scordelis_lo(n, elements), problems.pinched_cylinder(n, elements)
            entries.append(Entry("Scordelis-Lo roof, sag at mid-side", mesh, roof, 0.3024, MACNEAL))
            entries.append(Entry("Pinched cylinder, under the load", mesh, cylinder, 1.8248e-5, MACNEAL))
    entries += [
        Entry("Raasch hook, tip", f"andes + dkt, {n} across", problems.raasch_hook(n, ANDES), 4.706, "computed, DKGT")
        for n in (4, 8)
    ]
    return Table(
        "Curved shells, static",
        "Models of a quarter or an eighth. `cst` is too stiff in in-plane bending and needs the finer mesh on the "
        "roof. For deep-shell theory the roof's sag is 0.3006. The published 4.93 to 5.03 of the Raasch hook "
        "include transverse shear; a Kirchhoff triangle gives 4.706.",
        sorted(entries, key=lambda e: e.quantity, reverse=True),
    )


def beams() -> Table:
    entries = []
    for n in (24, 48, 96, 192):
        tip = problems.straight_cantilever(n, ANDES)
        for name, published in (("extension", 3e-5), ("in-plane", 0.1081), ("out-of-plane", 0.4321)):
            source = f"{MACNEAL} (unverified)"
            entries.append(
                Entry(f"straight cantilever, {name}", f"andes + dkt, {n} along", tip[name], published, source)
            )
    for n in (48, 192):
        bent = problems.curved_beam_in_plane(n, ANDES)
        mesh = f"andes + dkt, {n} along"
        exact = problems.curved_bar_exact()
        entries.append(Entry("curved beam, in-plane", mesh, bent, exact, "plane elasticity (Timoshenko-Goodier)"))
        entries.append(Entry("curved beam, in-plane", mesh, bent, 0.08734, f"{MACNEAL} beam formula (unverified)"))
    return Table(
        "Beams out of shell triangles",
        "Two published load cases are left out, the twist of the straight beam and the out-of-plane load of the "
        "curved one: the strip is half as thick as it is wide, so its torsion needs transverse shear.",
        entries,
    )


def plates() -> Table:
    cases = (
        ("clamped, uniform, w D / q a⁴", True, False, 0.00126532),
        ("clamped, central load, w D / P a²", True, True, 0.00560),
        ("simply supported, uniform, w D / q a⁴", False, False, 0.00406235),
        ("simply supported, central load, w D / P a²", False, True, 0.0116008),
    )
    entries = [
        Entry(name, f"dkt, {n} a side", problems.plate_deflection(n, clamped, point, CST), published, TIMOSHENKO)
        for name, clamped, point, published in cases
        for n in (8, 16, 32)
    ]
    return Table(
        "Square plates, static", "Poisson's ratio 0.3. The error falls with the square of the mesh size.", entries
    )


def plate_frequencies() -> Table:
    exact = math.pi**2 * np.array([2, 5, 5, 8, 10, 10])
    leissa = np.array([35.99, 73.41, 73.41, 108.27, 131.6, 132.2])
    entries = []
    for name, is_clamped, published, source in (
        ("simply supported", False, exact, "exact, pi² (m² + n²)"),
        ("clamped", True, leissa, "Leissa (unverified)"),
    ):
        found = problems.plate_frequencies(24, is_clamped, CST)
        entries += _modes(f"{name}, mode", "dkt, 24 a side", found, published, source, unit="")
    return Table("Square plates, frequencies", "Omega a² sqrt(rho h / D), lumped mass.", entries)


def reference_duct() -> Table:
    entries = []
    published = problems.sorted_duct_frequencies_hz()
    names = _mode_names()
    for elements, (n_around, n_along, count) in product((CST, ANDES), ((24, 36, 8), (60, 90, 24))):
        found = compute_modes(problems.reference_duct(n_around, n_along, elements), count).frequency_hz
        mesh = f"{label(elements)}, {n_around} x {n_along}"
        entries += [Entry(names[k], mesh, found[k], published[k], "Sanders Ritz, computed", "Hz") for k in range(count)]
    return Table(
        "Reference duct, frequencies",
        "A tube, clamped at one end: R 4 mm, L 40 mm, wall 0.5 mm, E 100 kPa, nu 0.45, rho 1060 kg/m³. Modes are "
        "named (waves around, order along). Torsion converges 0.3 % too high: the twist of flat facets adds h² / 3 R² "
        "to the torsional stiffness, and lumped mass has no rotary inertia. Thin-shell theory itself overestimates "
        "the ovalling of walls as thick as a cystic duct's.",
        entries,
    )


def _mode_names() -> list[str]:
    single = ("torsion", "torsion 2", "(0,1)")
    doubled = [(f, n) for n, f in problems.DUCT_RITZ_HZ.items() for _ in range(1 if n in single else 2)]
    return [name for _, name in sorted(doubled)]


def droop() -> Table:
    entries = [
        Entry(
            "mean drop of the free ring",
            f"{label(elements)}, {a} x {b}",
            1e3 * problems.duct_droop_m(a, b, elements),
            0.946,
            "Timoshenko beam",
            "mm",
        )
        for elements in (CST, ANDES)
        for a, b in ((12, 17), (20, 24), (40, 60))
    ]
    return Table(
        "Reference duct under 2 m/s² sideways",
        "Only the translations of the fixed ring are held.",
        entries,
    )


def independent_solver() -> Table:
    return Table(
        "Reference duct against OpenSees",
        "Both solvers have the same vertices and triangles, and DKT bending; the membrane of OpenSees is GT9. A "
        "point load on a free rim is the local case in which elements differ most.",
        [*_beside_opensees(CST), *_beside_opensees(ANDES)],
    )


def _beside_opensees(elements: ElementChoice) -> list[Entry]:
    model = problems.reference_duct(36, 54, elements)
    clamped = model.mesh.vertex_sets["clamped"]
    theirs = opensees_check.opensees_frequencies_hz(model, clamped, 10)
    ours = compute_modes(model, 10).frequency_hz
    mesh, source = f"{label(elements)}, 36 x 54", "OpenSees ShellDKGT, same mesh"
    entries = _modes("mode", mesh, ours[:10], theirs, source)
    mouth = model.mesh.vertex_sets["mouth"]
    pinch = np.zeros((model.mesh.n_vertices, 3))
    pinch[mouth[0], 1], pinch[mouth[18], 1] = -1e-3, 1e-3
    ours_m = model.solve_static(pinch).displacement_m[mouth[0], 1]
    theirs_m = opensees_check.opensees_displacement_m(model, clamped, pinch)[mouth[0], 1]
    entries.append(Entry("1 mN pinch across the mouth", mesh, 1e3 * ours_m, 1e3 * theirs_m, source, "mm"))
    return entries


def _modes(
    name: str, mesh: str, found: FloatArray, published: FloatArray | Sequence[float], source: str, unit: str = "Hz"
) -> list[Entry]:
    """Return a row for each mode; a mode that is double has one row, with both its numbers."""
    entries = []
    for k, reference in enumerate(published):
        is_second = k > 0 and math.isclose(reference, published[k - 1], rel_tol=1e-4)
        has_second = k + 1 < len(published) and math.isclose(reference, published[k + 1], rel_tol=1e-4)
        if not is_second:
            number = f"s {k + 1}, {k + 2}" if has_second else f" {k + 1}"
            entries.append(Entry(f"{name}{number}", mesh, found[k], reference, source, unit))
    return entries


def tocher_triangle() -> Table:
    tocher = ElementChoice("cst", "tocher")
    entries = [
        Entry(
            "simply supported plate, uniform load",
            f"tocher, {n} a side",
            problems.plate_deflection(n, False, False, tocher),
            0.00406235,
            TIMOSHENKO,
        )
        for n in (8, 16, 32)
    ]
    for n in (24, 48):
        found = compute_modes(problems.reference_duct(n, 3 * n // 2, tocher), 8).frequency_hz
        mesh, reference = f"cst + tocher, {n} x {3 * n // 2}", problems.sorted_duct_frequencies_hz()[:8]
        entries += _modes("duct, mode", mesh, found, reference, "Sanders Ritz, computed")
    return Table(
        "Tocher's bending triangle, the paper's",
        "Kept for comparison. It fails the patch test, so it converges to a wrong answer: a plate is a quarter too "
        "soft, and a duct ovals a tenth too slowly.",
        entries,
    )
