"""VTU output read back by VTK, the reader inside ParaView."""

import numpy as np
import pytest

from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.writing import write_vtu

pyvista = pytest.importorskip("pyvista", reason="the mesh extra is not installed")


def test_vtk_reads_back_what_was_written(tmp_path):
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 8, 6))
    rng = np.random.default_rng(0)
    moved, thickness = rng.standard_normal((mesh.n_vertices, 3)), rng.random(mesh.n_triangles)
    write_vtu(tmp_path / "duct.vtu", mesh, {"displacement_m": moved}, {"thickness_m": thickness})
    grid = pyvista.read(tmp_path / "duct.vtu")
    assert np.array_equal(grid.points, mesh.vertices_m)
    assert np.array_equal(grid.cells.reshape(-1, 4)[:, 1:], mesh.triangles)
    assert np.array_equal(grid.point_data["displacement_m"], moved)
    assert np.array_equal(grid.cell_data["thickness_m"], thickness)
