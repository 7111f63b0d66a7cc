"""Thick walls: transverse shear against closed forms, and a pinch against solids in CalculiX."""

import shutil

import numpy as np
import pytest

from tests.by_day import by_day
from tests.mechanics.fem.solid_tube import Pinch, shell_deflection, solid_deflection
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from trocar.studies.published.shells import mapped_patch

needs_calculix = pytest.mark.skipif(shutil.which("ccx") is None, reason="no CalculiX (ccx) on this machine")
LENGTH_M, WIDTH_M, YOUNG_PA, FORCE_N = 0.01, 0.008, 1e5, 1e-4


def tip_deflection(bending, thickness_m, n=24):
    patch = mapped_patch(n, 6, lambda s, t: (LENGTH_M * s, WIDTH_M * t, 0.0 * s))
    section = ShellSection(thickness_m, YOUNG_PA, 0.0, 1000.0)
    model = ShellModel(patch.mesh, section, [Support(patch.grid[0])], ElementChoice("cst", bending))
    load = np.zeros((patch.mesh.n_vertices, 3))
    weight = np.ones(7)
    weight[[0, -1]] = 0.5
    load[patch.grid[-1], 2] = FORCE_N * weight / weight.sum()
    return model.solve_static(load).displacement_m[patch.grid[-1], 2].mean()


@pytest.mark.parametrize("slenderness", [2.0, 4.0, 1000.0])
def test_a_beam_gives_way_by_bending_and_shear_as_timoshenko_says(slenderness):
    thickness = LENGTH_M / slenderness
    bent = FORCE_N * LENGTH_M**3 / (3.0 * YOUNG_PA * WIDTH_M * thickness**3 / 12.0)
    sheared = FORCE_N * LENGTH_M / (5.0 / 6.0 * 0.5 * YOUNG_PA * WIDTH_M * thickness)
    assert tip_deflection("dkmt", thickness) == pytest.approx(bent + sheared, rel=2e-3)
    assert tip_deflection("dkt", thickness) == pytest.approx(bent, rel=2e-3)


@needs_calculix
@pytest.mark.parametrize(
    ("pinch", "of_thin", "of_thick"),
    by_day(
        [(Pinch(radius_over_thickness=10.0, jaw=0.1), (-0.055, -0.045), (0.0, 0.015))],
        [
            (Pinch(radius_over_thickness=10.0, jaw=0.25), (-0.03, -0.015), (0.0, 0.015)),
            (Pinch(radius_over_thickness=20.0, jaw=0.1), (-0.03, -0.02), (-0.005, 0.005)),
        ],
    ),
    ids=str,
)
def test_a_thick_duct_is_pinched_as_easily_as_a_solid_one(pinch, of_thin, of_thick, tmp_path):
    """Within 1.5 % where the radius is ten thicknesses; thin elements are up to 5 % too stiff there."""
    solid = solid_deflection(pinch, 1e-3, tmp_path)
    error = {name: shell_deflection(pinch, 1e-3, name) / solid - 1.0 for name in ("dkt", "dkmt")}
    assert of_thin[0] < error["dkt"] < of_thin[1]
    assert of_thick[0] < error["dkmt"] < of_thick[1]
