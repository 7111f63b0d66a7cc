"""VTU output read back by VTK, the reader inside ParaView."""

import numpy as np
import pytest

from tests.studies.fem_files import DUCT, run, write
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.reading import read_surface
from trocar.services.meshes.writing import calculator_name, write_vtu

pyvista = pytest.importorskip("pyvista", reason="the mesh extra is not installed")


def test_vtk_reads_back_what_was_written(tmp_path):
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 8, 6))
    rng = np.random.default_rng(0)
    moved, thickness = rng.standard_normal((mesh.n_vertices, 3)), rng.random(mesh.n_triangles)
    constants = {"mode_1_frequency_hz": 0.1 + 0.2}
    write_vtu(tmp_path / "duct.vtu", mesh, {"displacement_m": moved}, {"thickness_m": thickness}, constants)
    grid = pyvista.read(tmp_path / "duct.vtu")
    assert np.array_equal(grid.points, mesh.vertices_m)
    assert np.array_equal(grid.cells.reshape(-1, 4)[:, 1:], mesh.triangles)
    assert np.array_equal(grid.point_data["displacement_m"], moved)
    assert np.array_equal(grid.cell_data["thickness_m"], thickness)
    assert grid.field_data["mode_1_frequency_hz"].tolist() == [0.1 + 0.2]
    again = read_surface(tmp_path / "duct.vtu", "m")
    assert set(again.vertex_sets) == set(mesh.vertex_sets)
    assert np.array_equal(again.vertex_sets["mouth"], np.sort(mesh.vertex_sets["mouth"]))


def test_names_are_those_that_paraview_s_calculator_takes(tmp_path):
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 8, 6))
    values = np.zeros(mesh.n_vertices)
    for name in ("mode 1", "a:b", "1st", "größe", ""):
        with pytest.raises(ValueError, match="no name that ParaView's calculator takes"):
            write_vtu(tmp_path / "duct.vtu", mesh, {name: values})
    assert calculator_name("end 1: größe") == "end_1__gr__e"
    assert not list(tmp_path.iterdir())


def test_vtk_s_calculator_takes_what_a_case_writes(tmp_path):
    """It parses names as ParaView's does."""
    from vtkmodules.vtkFiltersCore import vtkArrayCalculator

    path = write(tmp_path, DUCT | {"loads": [{"pressure_pa": 1.0}], "modes": 1})
    run(path, tmp_path)
    grid = pyvista.read(tmp_path / "out.vtu")
    names = [name for name in grid.point_data if grid.point_data[name].ndim == 2]
    assert "mode_1" in names
    for name in names:
        calculator = vtkArrayCalculator()
        calculator.SetInputData(grid)
        calculator.AddVectorArrayName(name)
        calculator.SetFunction(f"mag({name})")
        calculator.SetResultArrayName("length")
        calculator.Update()
        found = pyvista.wrap(calculator.GetOutput()).point_data["length"]
        np.testing.assert_allclose(found, np.linalg.norm(grid.point_data[name], axis=1))
