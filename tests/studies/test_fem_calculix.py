"""A case in CalculiX: what is written is what is solved here, both agree, and what does not go is a sentence."""

from __future__ import annotations

import shutil

import meshio
import numpy as np
import pytest

from tests.foreign_files.whole_files import TUBE, gmsh22
from tests.studies.fem_files import changed, clamped, run, write
from trocar.services.mechanics.surface.mesh import triangle_area_vectors
from trocar.services.meshes.reading import read_surface
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.studies.commands.fem import fem_command
from trocar.studies.fem import calculix
from trocar.studies.fem.calculix import Comparison, apart, compare, nodal_load, read_displacements, solve_by_calculix
from trocar.studies.fem.case import FemCase
from trocar.studies.fem.run import FemResult, solve_case

needs_ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
THICK = {"elements": {"membrane": "andes", "bending": "reissner"}}


def solved(folder, **changes) -> FemResult:
    case, _ = config.load(FemCase, write(folder, changed(**changes)))
    return solve_case(case, folder)


CASES = {
    "pressure": {"loads": [{"pressure_pa": 5.0}]},
    "weight": {"loads": [{"acceleration_m_s2": [0.0, 0.0, -9.81]}]},
    "drag": {"loads": [{"traction_pa": [0.5, 1.0, 0.0]}]},
    "force": {"loads": [{"force_n": [0.0, -1e-3, 0.0], "where": {"vertex_set": "mouth"}}]},
    "moved": {
        "supports": [
            clamped(),
            {"where": {"vertex_set": "mouth"}, "dofs": ["ux", "uy", "uz"], "displacement_m": [1e-4, 2e-4, 0.0]},
        ]
    },
    "stiffer somewhere": {
        "loads": [{"pressure_pa": 5.0}],
        "regions": [
            {"centre_m": [0.02, 0.004, 0.0], "radius_m": 6e-3, "modulus_factor": 8.0}
        ],
    },
}  # fmt: skip
#: Cases with the wall and supports of "pressure".
SAME_WALL = ("weight", "drag", "force")
FINE = {"mesh": {"parametric": {"radius_m": 0.004, "length_m": 0.03, "n_around": 32, "n_along": 32}}}


@needs_ccx
@pytest.mark.parametrize("name", CASES)
def test_both_agree(tmp_path, name):
    """Two elements on one faceted wall: of 24 cells round they are 4 % apart, of 48 1 %.

    Loads at rest change no frequency: one case looks at those of each wall and its supports.
    """
    modes = 0 if name in SAME_WALL else 2
    result = solved(tmp_path, **(FINE | THICK | {"modes": modes} | CASES[name]))
    other = solve_by_calculix(result)
    share = apart(result, other)
    assert share is not None
    assert share < 0.03, f"apart by {share:.3f}"
    if modes:
        assert other.frequency_hz is not None
        np.testing.assert_allclose(result.modes.frequency_hz, other.frequency_hz[:2], rtol=0.02)


def test_loads_written_are_the_loads_of_the_case(tmp_path):
    """The sum is that of the forces; of a pressure it is the pressure on all area vectors, of a weight the weight."""
    result = solved(tmp_path, loads=[{"pressure_pa": 5.0}], modes=0)
    mesh = result.model.mesh
    _, edge, _ = calculix.edge_of_half_edges(mesh)
    middles = mesh.n_vertices + edge.reshape(-1, 3)
    load = nodal_load(result, int(edge.max()) + 1, middles)
    np.testing.assert_allclose(load[:, :3].sum(axis=0), 5.0 * triangle_area_vectors(mesh).sum(axis=0), atol=1e-15)
    assert not load[: mesh.n_vertices].any()
    heavy = solved(tmp_path, loads=[{"acceleration_m_s2": [0.0, 0.0, -2.0]}], modes=0)
    load = nodal_load(heavy, int(edge.max()) + 1, middles)
    np.testing.assert_allclose(load[:, 2].sum(), -2.0 * heavy.model.mass_kg.sum())


def test_what_is_written_is_read_back_with_its_sets(tmp_path):
    case = write(tmp_path, changed(loads=[{"pressure_pa": 5.0}], modes=0))
    fem_command(case, inp_file=tmp_path / "case.inp")
    mesh = solved(tmp_path, loads=[{"pressure_pa": 5.0}], modes=0).model.mesh
    again = read_surface(tmp_path / "case.inp", "m")
    np.testing.assert_array_equal(again.triangles, mesh.triangles)
    np.testing.assert_array_equal(again.vertex_sets["MOUTH"], np.sort(mesh.vertex_sets["mouth"]))
    assert max(map(len, (tmp_path / "case.inp").read_text().splitlines())) < 132


def test_a_mesh_of_gmsh_is_held_and_probed_by_its_groups(tmp_path):
    (tmp_path / "tube.msh").write_bytes(gmsh22(TUBE, True))
    data = changed(
        mesh={"surface_file": {"path": "tube.msh", "units": "mm"}},
        supports=[{"where": {"vertex_set": "rim"}}],
        loads=[{"pressure_pa": 5.0}],
        probes={"wall": {"vertex_set": "wall"}},
        modes=0,
    )
    found = run(write(tmp_path, data), tmp_path)
    assert found["mesh"]["vertex_sets"] == {"wall": TUBE.n_vertices, "rim": 12}
    grid = meshio.read(tmp_path / "out.vtu")
    held = np.asarray(grid.point_data["rim"]) == 1
    assert not np.asarray(grid.point_data["displacement_m"])[held].any()
    again = data | {"mesh": {"surface_file": {"path": "first.vtu", "units": "m"}}, "supports": data["supports"]}
    (tmp_path / "second").mkdir()
    (tmp_path / "second" / "first.vtu").write_bytes((tmp_path / "out.vtu").read_bytes())
    second = run(write(tmp_path / "second", again), tmp_path / "second")
    assert second["static"]["largest_displacement_m"] == pytest.approx(
        found["static"]["largest_displacement_m"], rel=1e-9
    )
    with pytest.raises(ConfigError, match=r"has no vertex set 'inlet'; it has: wall, rim"):
        run(write(tmp_path, data | {"supports": [{"where": {"vertex_set": "inlet"}}]}), tmp_path)


@needs_ccx
def test_one_command_prints_the_comparison(tmp_path, capsys):
    case = write(tmp_path, changed(**FINE, **THICK, loads=[{"pressure_pa": 5.0}], modes=1))
    fem_command(case, by_calculix=True)
    said = capsys.readouterr().out
    assert "CalculiX, S6" in said
    assert "frequency 1 Hz" in said
    assert "all displacements differ by" in said


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"loads": [{"pressure_pa": 1.0}], "analysis": "nonlinear"}, "analysis: does not go with --inp and --calculix"),
        ({"loads": [{"pressure_pa": 1.0}], "buckling": 1}, "buckling: does not go"),
        (
            {"material": {"youngs_modulus_pa": 1e5, "poisson_ratio": 0.2, "density_kg_m3": 1e3,
                          "orthotropy": {"axis": [1.0, 0.0, 0.0], "modulus_ratio": 2.0, "shear_modulus_ratio": 0.4}}},
            "material.orthotropy: does not go",
        ),
    ],
)  # fmt: skip
def test_what_is_not_compared_is_refused_before_anything_is_solved(tmp_path, changes, said):
    with pytest.raises(ConfigError, match=said):
        fem_command(write(tmp_path, changed(**changes)), by_calculix=True)


def test_without_calculix_it_is_said(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigError, match="the program 'ccx' is not installed"):
        solve_by_calculix(solved(tmp_path, modes=1))


def test_a_calculix_that_gives_nothing_is_told_with_what_it_said(tmp_path, monkeypatch):
    (tmp_path / "ccx").write_text("#!/bin/sh\necho ' *ERROR reading *NODE. Card image:'\nexit 201\n")
    (tmp_path / "ccx").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    with pytest.raises(ConfigError, match=r"ccx gave no solution; it said: \*ERROR reading \*NODE"):
        solve_by_calculix(solved(tmp_path, modes=1))


def test_rounding_beside_the_largest_displacement_has_no_percentage(tmp_path):
    result = solved(tmp_path, loads=[{"pressure_pa": 5.0}], modes=0, probes={"rim": {"vertex_set": "mouth"}})
    theirs = 1.25 * result.static.displacement_m
    rows = {name: more for name, _, _, more in compare(result, Comparison(theirs, None))}
    assert rows["rim, y m"] is None
    assert rows["largest displacement m"] == pytest.approx(-0.2)
    assert apart(result, Comparison(theirs, None)) == pytest.approx(0.25)


def test_displacements_are_read_of_the_first_such_block():
    row = " -1{:10d}{:12.5E}{:12.5E}{:12.5E}\n"
    block = " -4  DISP        4    1\n -5  D1          1    2    1    0\n"
    frd = block + row.format(1, -1.5, 2.0, -3.0) + row.format(2, 0.0, 0.0, 1e-9) + " -3\n"
    frd += block + row.format(1, 9.0, 9.0, 9.0) + row.format(2, 9.0, 9.0, 9.0) + " -3\n"
    np.testing.assert_allclose(read_displacements(frd, 2), [[-1.5, 2.0, -3.0], [0.0, 0.0, 1e-9]])
    assert read_displacements(frd, 3) is None
    assert read_displacements("", 1) is None
