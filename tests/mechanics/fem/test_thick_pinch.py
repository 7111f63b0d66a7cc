"""Thick walls: transverse shear against closed forms, and a pinch against solids in CalculiX."""

import shutil

import numpy as np
import pytest

from tests.by_day import by_day
from tests.mechanics.fem.rigid_line import shell_stiffness, solid_stiffness
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
    ("pinch", "of_thin"),
    by_day(
        [(Pinch(radius_over_thickness=4.0, jaw=0.1), 0.15)],
        [
            (Pinch(radius_over_thickness=3.0, jaw=0.1), 0.25),
            (Pinch(radius_over_thickness=3.0, jaw=0.5), 0.08),
            (Pinch(radius_over_thickness=4.0, jaw=0.5), 0.04),
            (Pinch(radius_over_thickness=10.0, jaw=0.25), 0.015),
        ],
    ),
    ids=str,
)
def test_a_thick_duct_is_pinched_as_easily_as_a_solid_one(pinch, of_thin, tmp_path):
    """Within 5 % down to a radius of three thicknesses, and within 2.5 at four; thin elements are too stiff by more."""
    solid = solid_deflection(pinch, 1e-3, tmp_path)
    excess = {name: solid / shell_deflection(pinch, 1e-3, name) - 1.0 for name in ("dkt", "reissner")}
    assert excess["dkt"] > of_thin
    assert abs(excess["reissner"]) < (0.05 if pinch.radius_over_thickness < 4.0 else 0.025)


@needs_calculix
@pytest.mark.long
@pytest.mark.parametrize(("radius_over_thickness", "most"), [(3.0, 0.05), (4.0, 0.025), (10.0, 0.01)])
def test_so_it_is_by_rigid_lines(radius_over_thickness, most, tmp_path):
    solid = solid_stiffness(radius_over_thickness, tmp_path)
    assert abs(shell_stiffness(radius_over_thickness, "reissner") / solid - 1.0) < most
    assert shell_stiffness(radius_over_thickness, "dkt") / solid - 1.0 > 2.0 * most
