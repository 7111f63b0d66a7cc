"""Cyclic symmetry is found where a mesh has it, and every node is the copy that it is said to be."""

import dataclasses

import numpy as np
import pytest

from trocar.services.mechanics.surface.cyclic_symmetry import find_cyclic_symmetry, turned_about_x
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

STRAIGHT = DuctGeometry(4e-3, 40e-3, 18, 11)


@pytest.mark.parametrize("geometry", [STRAIGHT, dataclasses.replace(STRAIGHT, taper=0.3)], ids=["tube", "cone"])
def test_nodes_of_a_sector_are_those_of_the_first_turned(geometry):
    mesh = parametric_duct(geometry)
    symmetry = find_cyclic_symmetry(mesh)
    assert symmetry.n_sectors == 9, "diagonals alternate: two columns of cells make a sector"
    first_m = mesh.vertices_m[symmetry.first]
    for number in range(9):
        here = symmetry.sector == number
        wanted_m = turned_about_x(first_m[symmetry.seat[here]], 2.0 * np.pi * number / 9)
        assert mesh.vertices_m[here] == pytest.approx(wanted_m, abs=1e-15)
        assert sorted(symmetry.seat[here]) == list(range(len(first_m)))
    c, s = symmetry.turns[2]
    assert turned_about_x(np.array([0.0, 1.0, 0.0]), 4.0 * np.pi / 9) == pytest.approx([0.0, c, s])


def test_an_odd_number_of_cells_round_the_tube_has_none():
    assert find_cyclic_symmetry(parametric_duct(DuctGeometry(4e-3, 40e-3, 9, 4))) is None


@pytest.mark.parametrize("change", [{"curvature_1_m": 1.0}, {"cut_angle_rad": 0.01}, {"slit_length_m": 9e-3}])
def test_ducts_that_differ_from_side_to_side_have_none(change):
    assert find_cyclic_symmetry(parametric_duct(dataclasses.replace(STRAIGHT, **change))) is None


def test_a_moved_vertex_a_turned_diagonal_or_a_support_on_one_side_ends_it():
    mesh = parametric_duct(STRAIGHT)
    vertices = mesh.vertices_m.copy()
    vertices[100, 1] += 1e-9
    assert find_cyclic_symmetry(dataclasses.replace(mesh, vertices_m=vertices)) is None
    triangles = mesh.triangles.copy()
    (a, b, d), c = triangles[40], triangles[41, 1]
    assert list(triangles[41]) == [b, c, d]
    triangles[40], triangles[41] = (a, b, c), (a, c, d)
    assert find_cyclic_symmetry(dataclasses.replace(mesh, triangles=triangles)) is None
    held = {"clamped": mesh.vertex_sets["clamped"][:9]}
    assert find_cyclic_symmetry(dataclasses.replace(mesh, vertex_sets=held)) is None
    assert find_cyclic_symmetry(dataclasses.replace(mesh, vertex_sets={})) is None


def test_a_closed_tube_with_a_node_on_its_axis_has_none():
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 8, 4))
    rim, tip = np.arange(32, 40), mesh.n_vertices
    lid = np.stack([rim, np.roll(rim, -1), np.full(8, tip)], axis=1).astype(np.int32)
    closed = dataclasses.replace(
        mesh,
        vertices_m=np.vstack([mesh.vertices_m, [[45e-3, 0.0, 0.0]]]),
        triangles=np.vstack([mesh.triangles, lid]),
    )
    assert find_cyclic_symmetry(closed) is None
