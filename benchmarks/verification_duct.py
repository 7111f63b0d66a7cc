"""Verification tables of the shell: published statics and frequencies, the reference duct, an independent solver."""

from __future__ import annotations

import math

import numpy as np
from verification_table import Entry, Table

from services.mechanics.fem import ElementChoice, compute_modes
from services.studies import opensees_check
from services.studies import shell_problems as problems

CST, ANDES = ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")
MACNEAL = "MacNeal-Harder"
TIMOSHENKO = "Timoshenko, plates"


def tables() -> list[Table]:
    made = [statics(), beams(), plates(), plate_frequencies()]
    made += [reference_duct(CST), reference_duct(ANDES), droop(), tocher_triangle()]
    try:
        opensees_check.load_opensees()
    except ImportError as error:
        print(f"left out the independent solver: {error}")
        return made
    return [*made, independent_solver(CST), independent_solver(ANDES)]


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
        "Quarter and octant models. `cst` locks in in-plane bending and needs the finer mesh on the roof. The "
        "roof's deep-shell limit is 0.3006. The Raasch hook's 4.93 to 5.03 holds with transverse shear; a Kirchhoff "
        "triangle gives 4.706. Large deflections (Sze et al.) are the reduced model's, below.",
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
        "Twist of the straight beam (0.03208) and the curved beam's out-of-plane load (0.5022) are left out: the "
        "strip is half as thick as it is wide, its torsion needs transverse shear.",
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
        "Square plates, static", "Poisson's ratio 0.3; the error falls with the square of the mesh size.", entries
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
        entries += [Entry(f"{name}, mode {k + 1}", "dkt, 24 a side", found[k], published[k], source) for k in range(6)]
    return Table("Square plates, frequencies", "Omega a² sqrt(rho h / D), lumped mass.", entries)


def reference_duct(elements: ElementChoice) -> Table:
    entries = []
    published = problems.sorted_duct_frequencies_hz()
    names = _mode_names()
    for n_around, n_along, count in ((24, 36, 8), (60, 90, 24)):
        found = compute_modes(problems.reference_duct(n_around, n_along, elements), count).frequency_hz
        mesh = f"{n_around} x {n_along}"
        entries += [Entry(names[k], mesh, found[k], published[k], "Sanders Ritz, computed", "Hz") for k in range(count)]
    return Table(
        f"Reference duct, frequencies, {label(elements)}",
        "Case A, clamped-free: R 4 mm, L 40 mm, wall 0.5 mm, E 100 kPa, nu 0.45, rho 1060 kg/m³. Modes with waves "
        "round the rim are double. Torsion converges 0.3 % high: a flat facet's own twist adds h² / 3 R² to the "
        "torsional stiffness and lumped mass has no rotary inertia. Thin-shell theory itself over-predicts ovalling "
        "of walls as thick as a cystic duct's.",
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
    return Table("Reference duct under 2 m/s² sideways", "Only translations of the fixed ring are held.", entries)


def independent_solver(elements: ElementChoice) -> Table:
    model = problems.reference_duct(36, 54, elements)
    clamped = model.mesh.vertex_sets["clamped"]
    theirs = opensees_check.opensees_frequencies_hz(model, clamped, 10)
    ours = compute_modes(model, 10).frequency_hz
    entries = [
        Entry(f"mode {k + 1}", "36 x 54", ours[k], theirs[k], "OpenSees ShellDKGT, same mesh", "Hz") for k in range(10)
    ]
    mouth = model.mesh.vertex_sets["mouth"]
    pinch = np.zeros((model.mesh.n_vertices, 3))
    pinch[mouth[0], 1], pinch[mouth[18], 1] = -1e-3, 1e-3
    ours_m = model.solve_static(pinch).displacement_m[mouth[0], 1]
    theirs_m = opensees_check.opensees_displacement_m(model, clamped, pinch)[mouth[0], 1]
    source = "OpenSees ShellDKGT, same mesh"
    entries.append(Entry("1 mN pinch across the mouth", "36 x 54", 1e3 * ours_m, 1e3 * theirs_m, source, "mm"))
    return Table(
        f"Reference duct against OpenSees, {label(elements)}",
        "Same vertices and triangles. Bending is DKT in both; OpenSees's membrane is GT9. A point load on a free rim "
        "is the local case in which meshes differ most.",
        entries,
    )


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
        entries += [
            Entry(
                f"duct, mode {k + 1}",
                f"cst + tocher, {n} x {3 * n // 2}",
                found[k],
                ref,
                "Sanders Ritz, computed",
                "Hz",
            )
            for k, ref in enumerate(problems.sorted_duct_frequencies_hz()[:8])
        ]
    return Table(
        "Tocher's bending triangle, the paper's",
        "Kept for comparison. It fails the patch test, so it converges to a wrong answer: a plate a quarter too soft, "
        "ovalling of the duct a tenth too slow.",
        entries,
    )
