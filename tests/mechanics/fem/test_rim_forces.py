"""Forces on the rim of a faceted cylinder, and what stiff drilling freedoms make of them."""

import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from trocar.services.mechanics.fem.elements.andes import ALPHA_B
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.fem.facets import rim_eccentricity
from trocar.studies.published.shells import mapped_patch

RADIUS, LENGTH, YOUNG, NU = 1.0, 1.0, 1e6, 0.3
CST, ANDES = ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")


def pulled(n_around, thickness, elements, alpha=0.0):
    """Radial displacement of the rim of a cylinder pulled by 1 N, over that of theory without any bending; its mesh.

    With ``alpha`` the rim's vertices are also turned as a load spread along the edges turns them.
    """
    n_along = max(4, round(n_around * LENGTH / (2.0 * np.pi * RADIUS)))
    mesh = parametric_duct(DuctGeometry(RADIUS, LENGTH, n_around, n_along, wall_thickness_m=thickness))
    held, rim = mesh.vertex_sets["clamped"], mesh.vertex_sets["mouth"]
    section = ShellSection(thickness, YOUNG, NU, 1.0)
    quarter = int(held[n_around // 4])
    across = "uy" if abs(mesh.vertices_m[quarter, 1]) < 1e-9 else "uz"
    supports = [Support(held, ("ux",)), Support(held[:1], ("uy", "uz")), Support(np.array([quarter]), (across,))]
    load = np.zeros((mesh.n_vertices, 6))
    load[rim, 0] = 1.0 / n_around
    here, there = mesh.vertices_m[rim], mesh.vertices_m[np.roll(rim, -1)]
    along, normal = there - here, 0.5 * (there + here) * [0.0, 1.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    turn = alpha / 12.0 / n_around * np.cross(normal, along)[:, :1] * normal
    load[rim, 3:] += turn
    load[np.roll(rim, -1), 3:] -= turn
    moved = ShellModel(mesh, section, supports, elements).solve_static(load).displacement_m[rim]
    radial = here * [0.0, 1.0, 1.0] / RADIUS
    without_bending = -NU / (2.0 * np.pi * YOUNG * thickness)
    return float(np.einsum("ij,ij->i", moved, radial).mean()) / without_bending, mesh, section


@pytest.mark.parametrize("n_around", [96, 120])
def test_a_rim_under_forces_bends_as_far_as_foretold(n_around):
    """The edge of a long cylinder moves by M / 2 beta² D under a moment M (Timoshenko and Woinowsky-Krieger)."""
    thickness = 0.05
    moves, mesh, section = pulled(n_around, thickness, ANDES)
    beside_m = thickness * rim_eccentricity(mesh, section, mesh.vertex_sets["mouth"])
    flexibility = 6.0 * (1.0 - NU**2) / np.sqrt(3.0 * (1.0 - NU**2)) / thickness**2
    foretold = flexibility * beside_m * RADIUS / (NU * RADIUS / thickness)
    assert moves - 1.0 == pytest.approx(foretold, rel=0.04)


def test_with_the_moments_of_a_load_along_the_edges_there_is_no_bending():
    for n_around, thickness in ((32, 0.02), (64, 0.05)):
        assert pulled(n_around, thickness, ANDES, ALPHA_B)[0] == pytest.approx(1.0, abs=4e-3)
        assert pulled(n_around, thickness, CST)[0] == pytest.approx(1.0, abs=4e-3)


def test_a_flat_rim_and_an_inner_edge_have_none():
    patch = mapped_patch(4, 4, lambda s, t: (s, t, 0.0 * s))
    assert rim_eccentricity(patch.mesh, ShellSection(0.01, 1.0, 0.3, 1.0), patch.grid[0]) == 0.0
    _, mesh, section = pulled(16, 0.1, CST)
    ring = np.arange(16, 32, dtype=np.int32)
    assert rim_eccentricity(mesh, section, ring) == 0.0
