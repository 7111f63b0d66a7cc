"""Files of `trocar fem` cases, for tests: a small duct, and what differs from it."""

import json

import numpy as np
import pytest
import yaml

from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.studies.commands.fem import fem_command
from trocar.studies.published.shells import mapped_patch

DUCT = {
    "mesh": {"parametric": {"radius_m": 0.004, "length_m": 0.04, "n_around": 12, "n_along": 12}},
    "thickness_m": 0.5e-3,
    "material": {"youngs_modulus_pa": 1e5, "poisson_ratio": 0.45, "density_kg_m3": 1060.0},
    "supports": [{"where": {"vertex_set": "clamped"}}],
    "modes": 2,
}


def write(folder, data, name="case.yaml"):
    path = folder / name
    path.write_text(yaml.safe_dump(data))
    return path


def run(path, tmp_path):
    fem_command(path, tmp_path / "out.json", tmp_path / "out.vtu")
    return json.loads((tmp_path / "out.json").read_text())


def changed(**changes):
    return DUCT | changes


def clamped():
    return {"where": {"vertex_set": "clamped"}}


def held(displacement_m, *dofs, vertex=150):
    given = {"dofs": list(dofs)} if dofs else {}
    return {"where": {"vertex": vertex}, "displacement_m": displacement_m} | given


def surface_case(tmp_path, mesh, **changes):
    trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")
    trimesh.Trimesh(mesh.vertices_m, mesh.triangles, process=False).export(tmp_path / "surface.stl")
    lowest = [[-9, -9, -9], [9, 9, float(mesh.vertices_m[:, 2].min()) + 0.1]]
    case = {
        "mesh": {"surface_file": {"path": "surface.stl", "units": "m"}},
        "supports": [{"where": {"box_m": lowest}}],
        "loads": [{"pressure_pa": 10.0}],
        "modes": 0,
    }
    return write(tmp_path, changed(**case | changes))


def square(share_turned):
    """A unit square standing on its edge, of which a share of the triangles is wound the other way."""
    mesh = mapped_patch(8, 8, lambda s, t: (s, np.zeros_like(s), t)).mesh
    triangles = mesh.triangles.copy()
    turned = slice(0, round(share_turned * len(triangles)))
    triangles[turned] = triangles[turned, ::-1]
    return TriangleMesh(mesh.vertices_m, triangles)
