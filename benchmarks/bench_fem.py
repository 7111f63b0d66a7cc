"""Time of assembling and factorising a shell of 20,000 triangles, element by element.

python benchmarks/bench_fem.py
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from functools import partial

from report import Row, measure, parse, write_report

from trocar.services.mechanics.fem import ElementChoice, ShellModel, clamp
from trocar.services.mechanics.fem.assembly import assemble_stiffness
from trocar.services.mechanics.fem.elements import BENDING_ELEMENTS, MEMBRANE_ELEMENTS
from trocar.studies.published.shells import REFERENCE_SECTION, reference_duct

CHOICES = [ElementChoice(membrane, bending) for membrane in MEMBRANE_ELEMENTS for bending in BENDING_ELEMENTS]


def factorise(model: ShellModel) -> None:
    """Supports, elimination and sparse factors, from the assembled model on."""
    fresh = ShellModel(model.mesh, model.section, [clamp(model.mesh)], model.elements)
    _ = fresh.factor


def main() -> None:
    """Measure and write benchmarks/results/fem.*."""
    arguments = parse(__doc__, samples=(7, "assemblies with each element"))
    model = reference_duct(100, 100, CHOICES[0])
    calls = {
        f"assembly, {c.membrane} + {c.bending}": partial(assemble_stiffness, model.mesh, REFERENCE_SECTION, c)
        for c in CHOICES
    }
    timings = measure(calls, samples=arguments.samples, warmup=1)
    rows = [Row.from_timing(name, timing, limit_s=2.0) for name, timing in timings.items()]
    whole = measure({"model and sparse factors, cst + dkt": partial(factorise, model)}, samples=3, warmup=1)
    rows += [Row.from_timing(name, timing) for name, timing in whole.items()]
    notes = f"{model.mesh.n_triangles} triangles, {len(model.free_dofs)} free dofs, one thread."
    write_report("fem", "Shell finite elements", rows, notes)


if __name__ == "__main__":
    main()
