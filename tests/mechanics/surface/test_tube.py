"""The parametric duct against closed forms, and over its whole parameter range."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.surface.mesh import boundary_loops, half_edges, triangle_area_vectors, triangle_areas_m2
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

R, L = 4e-3, 40e-3


def ring_order_is_unbroken(mesh, rim):
    edges = {frozenset(edge) for edge in half_edges(mesh).tolist()}
    return all(frozenset(pair) in edges for pair in zip(rim.tolist(), np.roll(rim, -1).tolist(), strict=True))


def test_straight_tube_stands_where_it_should():
    mesh = parametric_duct(DuctGeometry(R, L, 24, 36))
    assert np.ptp(mesh.vertices_m[mesh.vertex_sets["clamped"], 0]) == 0.0
    assert mesh.vertices_m[mesh.vertex_sets["mouth"], 0] == pytest.approx(np.full(24, L))
    assert np.hypot(*mesh.vertices_m[:, 1:].T) == pytest.approx(np.full(mesh.n_vertices, R))


def test_area_of_a_tapered_duct_converges_to_the_cone():
    geometry = DuctGeometry(R, L, 200, 40, taper=0.5)
    mean_radius, slant = 0.75 * R, math.hypot(L, 0.5 * R)
    cone = 2 * math.pi * mean_radius * slant
    assert triangle_areas_m2(parametric_duct(geometry)).sum() == pytest.approx(cone, rel=1e-3)


def test_curved_axis_is_an_arc_of_the_given_curvature():
    curvature = 30.0
    mesh = parametric_duct(DuctGeometry(R, L, 24, 36, curvature_1_m=curvature))
    end = mesh.vertices_m[mesh.vertex_sets["mouth"]].mean(axis=0)
    turn = curvature * L
    assert end == pytest.approx([math.sin(turn) / curvature, (1 - math.cos(turn)) / curvature, 0.0], abs=1e-12)


def test_oblique_mouth_is_one_plane_at_the_given_angle():
    angle = 0.6
    mesh = parametric_duct(DuctGeometry(R, L, 24, 36, taper=0.2, cut_angle_rad=angle))
    mouth = mesh.vertices_m[mesh.vertex_sets["mouth"]]
    assert mouth[:, 0] - L == pytest.approx(math.tan(angle) * mouth[:, 1], abs=1e-12)


def test_incision_has_its_length_and_width_and_one_rim():
    slit, width = 9e-3, 2e-3
    mesh = parametric_duct(DuctGeometry(R, L, 24, 36, slit_length_m=slit, slit_width_m=width))
    mouth = mesh.vertex_sets["mouth"]
    assert len(boundary_loops(mesh)) == 2
    assert ring_order_is_unbroken(mesh, mouth)
    assert mesh.vertices_m[mouth, 0].min() == pytest.approx(L - slit)
    lips = mesh.vertices_m[mouth][np.isclose(mesh.vertices_m[mouth, 0], L)]
    gap = np.linalg.norm(lips - np.roll(lips, -1, axis=0), axis=1).max()
    assert gap == pytest.approx(2 * R * math.sin(0.5 * width / R), rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    taper=st.floats(0, 0.6),
    curvature=st.floats(-60, 60),
    cut=st.floats(-0.9, 0.9),
    slit=st.one_of(st.just(0.0), st.floats(5e-3, 20e-3)),
    width=st.floats(0, 4e-3),
    n_around=st.integers(6, 20),
    n_along=st.integers(4, 30),
)
def test_every_duct_is_a_clean_tube(taper, curvature, cut, slit, width, n_around, n_along):
    mesh = parametric_duct(DuctGeometry(R, L, n_around, n_along, 0.5e-3, taper, curvature, cut, slit, width))
    assert triangle_areas_m2(mesh).min() > 1e-12
    assert len(boundary_loops(mesh)) == 2
    assert ring_order_is_unbroken(mesh, mesh.vertex_sets["mouth"])
    assert ring_order_is_unbroken(mesh, mesh.vertex_sets["clamped"])
    first_cells = triangle_area_vectors(mesh)[: 2 * n_around]
    centres = mesh.vertices_m[mesh.triangles[: 2 * n_around]].mean(axis=1)
    axis = mesh.vertices_m[mesh.triangles[: 2 * n_around]].mean(axis=(0, 1))
    assert np.sum(first_cells * (centres - axis), axis=1).min() > 0.0


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"radius_m": -1.0}, "radius_m"),
        ({"length_m": math.nan}, "length_m"),
        ({"n_around": 2}, "n_around"),
        ({"taper": 1.0}, "wall_thickness_m"),
        ({"curvature_1_m": 260.0}, "curvature_1_m"),
        ({"cut_angle_rad": 1.55}, "cut_angle_rad"),
        ({"slit_length_m": 50e-3}, "slit_length_m"),
        ({"slit_length_m": 1e-6}, "slit_length_m"),
        ({"slit_length_m": -1e-3}, "slit_length_m"),
        ({"slit_width_m": 20e-3}, "slit_width_m"),
    ],
)
def test_impossible_ducts_are_refused_by_name(change, key):
    values = {"radius_m": R, "length_m": L, "n_around": 12, "n_along": 12} | change
    with pytest.raises(ValueError, match=key):
        DuctGeometry(**values)
