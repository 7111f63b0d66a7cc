"""A catheter on a slope: where it begins to slide and what friction acts then, over contacts, wall, step, coefficients.

    python benchmarks/bench_slope.py

Writes benchmarks/results/slope.md.
"""

from __future__ import annotations

from pathlib import Path

from report import parse

from trocar.studies.slope import Incline, slide

REPORT = Path(__file__).resolve().parent / "results" / "slope.md"
HEAD = """# A catheter on a slope

Made by `python benchmarks/bench_slope.py`; do not edit by hand. A slope is tilted slowly under a catheter in a duct,
to either side, and held where the catheter slides. It should begin to slide at the static coefficient and slide with
the kinetic one; both errors are relative to these.

| length | segments | contacts | wall | step | static | kinetic | onset | error | sliding | error |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
INCLINES = (
    Incline(length_m=2e-3, n_segments=2),
    Incline(length_m=6e-3, n_segments=4),
    Incline(length_m=12e-3, n_segments=10),
    Incline(),
    Incline(n_segments=60),
    Incline(youngs_modulus_pa=20e3),
    Incline(youngs_modulus_pa=2e6),
    Incline(dt_s=2e-3),
    Incline(dt_s=2.5e-4),
    Incline(mu=(0.12, 0.08)),
    Incline(mu=(0.3, 0.3)),
    Incline(mu=(0.6, 0.2)),
)


def line_of(incline: Incline) -> str:
    """Measure one slope and return its line of the table."""
    slid, (static, kinetic) = slide(incline), incline.mu
    given = f"{1e3 * incline.length_m:.0f} mm | {incline.n_segments} | {slid.contacts:.0f}"
    wall, step = f"{1e-3 * incline.youngs_modulus_pa:.0f} kPa", f"{1e3 * incline.dt_s:g} ms"
    errors = [f"{100.0 * (found / law - 1.0):+.1f} %" for found, law in ((slid.onset, static), (slid.sliding, kinetic))]
    found = f"{slid.onset:.4f} | {errors[0]} | {slid.sliding:.4f} | {errors[1]}"
    return f"| {given} | {wall} | {step} | {static} | {kinetic} | {found} |"


def main() -> None:
    """Measure all slopes and write the table."""
    parse(__doc__)
    lines = []
    for incline in INCLINES:
        lines.append(line_of(incline))
        print(lines[-1], flush=True)
    REPORT.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
