"""Torsion of thick tubes: what flat facets add, what drilling freedoms add to that, and that it is foretold."""

import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellSection
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.fem.facets import drilling_excess
from trocar.studies.published.shells import mapped_patch
from trocar.studies.published.torsion import tube_torsion

CST, ANDES = ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")
CELLS = [(24, 8), (24, 24), (24, 48), (24, 96)]


def test_constant_strain_facets_converge_to_flat_strips_whatever_the_cells():
    """Richardson from two meshes; the limit of strips is 1/27 at R/h 3, a solid tube's is 1/36."""
    for cells_a_length in (1, 3):
        coarse, fine = (tube_torsion(n, cells_a_length * n // 3, CST, 3.0) for n in (24, 48))
        assert fine + (fine - coarse) / 3.0 == pytest.approx(1.0 + 1.0 / 27.0, abs=1e-3)


@pytest.mark.parametrize("ratio", [3.0, 8.0])
@pytest.mark.parametrize(("n_around", "n_along"), CELLS)
def test_what_drilling_freedoms_add_is_foretold(n_around, n_along, ratio):
    added = tube_torsion(n_around, n_along, ANDES, ratio) / tube_torsion(n_around, n_along, CST, ratio) - 1.0
    mesh = parametric_duct(DuctGeometry(1.0, 6.0, n_around, n_along, wall_thickness_m=1.0 / ratio))
    foretold = drilling_excess(mesh, ShellSection(1.0 / ratio, 1e5, 0.45, 1.0))
    assert foretold == pytest.approx(added, rel=0.2, abs=1.5e-3)


def test_flat_walls_and_creases_have_none():
    flat = mapped_patch(4, 4, lambda s, t: (s, t, 0 * s)).mesh
    section = ShellSection(0.1, 1e5, 0.3, 1.0)
    assert drilling_excess(flat, section) == 0.0
    folded = flat.vertices_m.copy()
    folded[:, 2] = 2.0 * abs(folded[:, 0] - 0.5)
    assert drilling_excess(TriangleMesh(folded, flat.triangles), section) == 0.0
