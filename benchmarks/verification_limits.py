"""Verification tables of the shell at its limits: buckling, and torsion of thick walls."""

from __future__ import annotations

from verification_duct import ANDES, CST, label
from verification_table import Entry, Table

from trocar.studies.published.buckling import (
    PLATE_COEFFICIENT,
    column_buckling,
    cylinder_buckling,
    plate_buckling,
    ring_buckling,
)
from trocar.studies.published.torsion import tube_torsion


def tables() -> list[Table]:
    return [buckling(), torsion()]


def buckling() -> Table:
    entries = []
    for elements in (CST, ANDES):
        for (load, is_clamped), published in PLATE_COEFFICIENT.items():
            quantity = f"{'clamped' if is_clamped else 'simply supported'} plate, {load}, N b² / pi² D"
            source = "exact" if published in (2.0, 4.0) else "Timoshenko-Gere (unverified)"
            for n in (8, 16, 32):
                found = plate_buckling(n, load, is_clamped, elements)[0]
                entries.append(Entry(quantity, f"{label(elements)}, {n} a side", found, published, source))
        for f in (1, 2):
            mesh = f"{label(elements)}, {{}} x {{}}".format
            entries += [
                Entry(
                    "long tube as a column",
                    mesh(16 * f, 40 * f),
                    column_buckling(16 * f, 40 * f, elements),
                    1.0,
                    "Euler, Engesser",
                ),
                Entry(
                    "cylinder, R/h 25, axial",
                    mesh(60 * f, 10 * f),
                    cylinder_buckling(60 * f, 10 * f, elements),
                    1.0,
                    "E h² / R sqrt(3)",
                ),
            ]
            two, _, three, _ = ring_buckling(24 * f, elements)
            entries.append(Entry("ring under pressure, two waves", mesh(24 * f, 8 * f), two, 1.0, "Bresse, 3 E I / R³"))
            entries.append(
                Entry("ring under pressure, three waves", mesh(24 * f, 8 * f), three, 8.0 / 3.0, "Bresse, 8 E I / R³")
            )
    return Table(
        "Buckling",
        "Linear buckling: the state before it is that of small displacements. Loads of columns, cylinders and rings "
        "are divided by the theoretical value. The classical stress of the cylinder leaves out terms of order h / R:"
        " at R/h 100 on 360 x 30 cells the ratio is 0.992. Pressure stays normal to the wall.",
        sorted(entries, key=lambda e: e.quantity),
    )


def torsion() -> Table:
    entries = [
        Entry(
            f"torsion, R/h {ratio:g}",
            f"{label(elements)}, {a} x {b}",
            tube_torsion(a, b, elements, ratio),
            1.0 + 1.0 / (4.0 * ratio**2),
            "solid tube",
        )
        for ratio in (3.0, 8.0)
        for elements in (CST, ANDES)
        for a, b in ((24, 24), (48, 48), (96, 96), (24, 8), (48, 16), (96, 32), (24, 96), (48, 192))
    ]
    return Table(
        "Thick walls: torsion",
        "Torsional stiffness of a tube, divided by that of a thin wall, G 2 pi R³ h. Six radii long, nu 0.45, "
        "measured in the middle half. Flat strips converge to 1 + h² / 3 R²; a solid tube has 1 + h² / 4 R², "
        "Sanders's shell 1 + 3 h² / 16 R². `andes` converges to a higher value that depends on the shape of its "
        "cells.",
        entries,
    )
