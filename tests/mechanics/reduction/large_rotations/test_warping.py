"""Large rotations: published large deflections, volume, invariances, derivatives."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.mechanics.reduction.large_rotations.warped import warped_positions
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.reduction import ModalBasis
from trocar.services.mechanics.reduction.build import build_basis
from trocar.services.mechanics.reduction.large_rotations.sections import axial_coordinate, cut_sections
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, alternating_triangles, parametric_duct

# Sze, Liu, Lo, Finite Elements in Analysis and Design 40:1551 (2004): cantilever under end shear,
# L 10, W 1, t 0.1, E 1.2e6, nu 0, Pmax 4: load fraction, tip deflection, tip shortening.
SZE = [(0.25, 3.015, 0.563), (0.5, 4.933, 1.604), (0.75, 6.031, 2.541), (1.0, 6.698, 3.286)]
LENGTH, WIDTH, EI = 10.0, 1.0, 1.2e6 * 1.0 * 0.1**3 / 12.0


@pytest.fixture(scope="module")
def strip() -> ShellModel:
    x, y = np.meshgrid(np.linspace(0.0, LENGTH, 41), np.linspace(0.0, WIDTH, 5), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    grid = np.arange(x.size).reshape(x.shape)
    mesh = TriangleMesh(vertices, alternating_triangles(grid), {"clamped": grid[0], "tip": grid[-1]})
    return ShellModel(mesh, ShellSection(0.1, 1.2e6, 0.0, 1000.0), [clamp(mesh)], ElementChoice("andes", "dkt"))


@pytest.fixture(scope="module")
def strip_basis(strip) -> ModalBasis:
    return build_basis(strip, 20)


@pytest.fixture(scope="module")
def tube_warp(model, basis) -> TubeWarp:
    return TubeWarp.from_basis(model.mesh, basis, model.mesh.vertex_sets["clamped"])


def tip_under_end_shear(model, basis, load_n):
    """Equilibrium of the warped reduced strip under a dead load: the minimum of strain energy less work."""
    tip = model.mesh.vertex_sets["tip"]
    share = np.array([0.5, 1.0, 1.0, 1.0, 0.5]) / 4.0
    frame = SectionFrame(TubeWarp.from_basis(model.mesh, basis, model.mesh.vertex_sets["clamped"]))
    rows, positions, no_residual = np.empty((5, 3, basis.n_modes)), np.empty((5, 3)), np.zeros((5, 3))

    def energy(scaled):
        # Coordinates scaled by frequency make the strain energy round and the search short.
        frame.update(scaled / basis.omega_rad_s)
        frame.node_positions(tip, no_residual, positions)
        frame.node_rows(tip, no_residual, rows)
        gradient = scaled - load_n * (share @ rows[:, 2]) / basis.omega_rad_s
        return 0.5 * scaled @ scaled - load_n * (share @ positions[:, 2]), gradient

    result = minimize(energy, np.zeros(basis.n_modes), jac=True, method="BFGS", options={"gtol": 1e-7})
    energy(result.x)
    return share @ positions


@pytest.mark.parametrize(("fraction", "deflection", "shortening"), SZE)
def test_cantilever_under_end_shear_deflects_as_published(strip, strip_basis, fraction, deflection, shortening):
    tip = tip_under_end_shear(strip, strip_basis, 4.0 * fraction)
    linear = 4.0 * fraction * LENGTH**3 / (3.0 * EI)
    print(f"P/Pmax {fraction}: w {tip[2]:.3f} ({deflection}), u {LENGTH - tip[0]:.3f} ({shortening}), linear {linear}")
    assert tip[2] == pytest.approx(deflection, rel=5e-3)
    assert LENGTH - tip[0] == pytest.approx(shortening, rel=5e-3)


@pytest.mark.parametrize("turns", [0.25, 0.5, 1.0])
def test_cantilever_under_end_moment_bends_to_a_circle(strip, strip_basis, turns):
    tip = strip.mesh.vertex_sets["tip"]
    load = np.zeros((strip.mesh.n_vertices, 6))
    angle = 2.0 * np.pi * turns
    load[tip, 4] = -EI * angle / LENGTH * np.array([0.5, 1.0, 1.0, 1.0, 0.5]) / 4.0
    linear = strip.solve_static(load).displacement_m
    q = np.einsum("nir,n,ni->r", strip_basis.Phi, strip.mass_kg, linear)
    warp = TubeWarp.from_basis(strip.mesh, strip_basis, strip.mesh.vertex_sets["clamped"])
    radius = LENGTH / angle
    expected = [radius * np.sin(angle), 0.5, radius * (1.0 - np.cos(angle))]
    assert warped_positions(warp, q)[tip].mean(axis=0) == pytest.approx(expected, abs=0.01 * LENGTH)


def enclosed_volume(mesh, positions):
    """Volume within a tube whose two rims are closed by fans about their centres."""
    a, b, c = (positions[mesh.triangles[:, k]] for k in range(3))
    volume = np.sum(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6.0
    for name, sign in (("clamped", 1.0), ("mouth", -1.0)):
        rim = positions[mesh.vertex_sets[name]]
        fan = np.cross(rim, np.roll(rim, -1, axis=0)) @ rim.mean(axis=0)
        volume -= sign * fan.sum() / 6.0
    return abs(volume)


def test_a_duct_bent_by_a_right_angle_keeps_its_volume_and_its_length(model, basis, tube_warp):
    mesh = model.mesh
    forces = np.zeros((mesh.n_vertices, 3))
    forces[mesh.vertex_sets["mouth"], 1] = 1.0
    q = np.einsum("nir,ni->r", basis.Phi, forces) / basis.omega_rad_s**2
    tip = mesh.vertex_sets["mouth"]
    frame = SectionFrame(tube_warp)
    q *= 0.5 * np.pi / np.linalg.norm(tube_warp.turn[-1] @ q)
    frame.update(q)
    rest = enclosed_volume(mesh, mesh.vertices_m)
    warped = warped_positions(tube_warp, q)
    straight = mesh.vertices_m + basis.displacements(q)
    axis_m = np.linalg.norm(np.diff(frame.centres_m, axis=0), axis=1).sum()
    print(
        f"bent by 90 degrees: volume {enclosed_volume(mesh, warped) / rest - 1.0:+.2%} warped, "
        f"{enclosed_volume(mesh, straight) / rest - 1.0:+.0%} without; tip {warped[tip].mean(axis=0)}"
    )
    assert rest == pytest.approx(np.pi * 4e-3**2 * 40e-3, rel=0.03)
    assert enclosed_volume(mesh, warped) == pytest.approx(rest, rel=0.01)
    assert enclosed_volume(mesh, straight) > 1.2 * rest
    assert axis_m == pytest.approx(
        np.linalg.norm(np.diff(tube_warp.sections.centres_m, axis=0), axis=1).sum(), rel=0.01
    )


def some_coordinates(basis, size_m):
    q = np.random.default_rng(5).standard_normal(basis.n_modes) / basis.omega_rad_s
    return q * size_m / np.abs(basis.displacements(q)).max()


def test_nothing_moves_at_rest(model, basis, tube_warp):
    assert warped_positions(tube_warp, np.zeros(basis.n_modes)) == pytest.approx(model.mesh.vertices_m, abs=1e-16)


def test_small_displacements_are_the_linear_ones_to_second_order(model, basis, tube_warp):
    errors = []
    for size in (1e-4, 1e-5):
        q = some_coordinates(basis, size)
        linear = model.mesh.vertices_m + basis.displacements(q)
        errors.append(np.abs(warped_positions(tube_warp, q) - linear).max())
    assert np.log10(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_the_held_end_stays(model, basis, tube_warp):
    held = model.mesh.vertex_sets["clamped"]
    moved = warped_positions(tube_warp, some_coordinates(basis, 20e-3))[held]
    assert moved == pytest.approx(model.mesh.vertices_m[held], abs=1e-15)


@pytest.mark.parametrize("carried_m", [0.0, 2e-3])
def test_rows_are_the_derivative_of_the_positions(basis, tube_warp, carried_m):
    nodes = np.array([0, 25, 333, 610], np.int32)
    q, frame = some_coordinates(basis, 20e-3), SectionFrame(tube_warp)
    rows, sides, extra = np.empty((4, 3, basis.n_modes)), np.empty((2, 4, 3)), np.full((4, 3), carried_m)
    frame.update(q)
    frame.node_rows(nodes, extra, rows)
    direction = np.random.default_rng(6).standard_normal(basis.n_modes) / basis.omega_rad_s
    step = 1e-5 * np.linalg.norm(q) / np.linalg.norm(direction)
    for side, sign in zip(sides, (-1.0, 1.0), strict=True):
        frame.update(q + sign * step * direction)
        frame.node_positions(nodes, extra, side)
    difference = (sides[1] - sides[0]) / (2.0 * step)
    assert rows @ direction == pytest.approx(difference, abs=1e-6 * np.abs(difference).max())


def test_a_turned_duct_warps_to_the_turned_shape(model, basis, tube_warp):
    turn = np.linalg.qr(np.random.default_rng(7).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    mesh = model.mesh
    turned_mesh = TriangleMesh(mesh.vertices_m @ turn.T, mesh.triangles, mesh.vertex_sets)
    turned_basis = ModalBasis.from_modes(basis.omega_rad_s, np.einsum("ij,njr->nir", turn, basis.Phi))
    turned_warp = TubeWarp.from_basis(turned_mesh, turned_basis, mesh.vertex_sets["clamped"])
    q = some_coordinates(basis, 20e-3)
    # The axial coordinate is a square root: rounding of 1e-16 shows as 1e-8 of a length at the free end.
    assert warped_positions(turned_warp, q) == pytest.approx(warped_positions(tube_warp, q) @ turn.T, abs=1e-8 * 40e-3)


def test_what_rides_along_is_turned_with_its_section(basis, tube_warp):
    q, frame = some_coordinates(basis, 20e-3), SectionFrame(tube_warp)
    frame.update(q)
    node, rotations = np.array([500], np.int32), np.empty((1, 3, 3))
    frame.node_rotations(node, rotations)
    rotation = rotations[0]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    plain, carried, extra = np.empty((1, 3)), np.empty((1, 3)), np.array([[1e-3, -2e-3, 3e-3]])
    frame.node_positions(node, 0.0 * extra, plain)
    frame.node_positions(node, extra, carried)
    assert (carried - plain)[0] == pytest.approx(rotation @ extra[0], abs=1e-15)


def test_axial_coordinate_is_the_distance_on_a_straight_tube(model):
    x = axial_coordinate(model.mesh, model.mesh.vertex_sets["clamped"])
    assert x == pytest.approx(model.mesh.vertices_m[:, 0] / 40e-3, abs=0.02)


def test_a_mesh_too_coarse_for_its_sections_is_refused(basis):
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 6, 3))
    axis_basis = ModalBasis.from_modes(basis.omega_rad_s[:1], np.zeros((mesh.n_vertices, 3, 1)))
    with pytest.raises(ValueError, match="too coarse for 24 cross-sections"):
        TubeWarp.from_basis(mesh, axis_basis, mesh.vertex_sets["clamped"])


def test_a_section_whose_nodes_lie_on_a_line_is_refused_before_a_basis_is_made():
    """A bend draws the nodes of a ring apart along the axis: the last section keeps too few."""
    mesh = parametric_duct(DuctGeometry(5.54e-3, 37.37e-3, 12, 12, curvature_1_m=11.28))
    with pytest.raises(ValueError, match="24 cross-sections: the nodes of one lie on a line"):
        cut_sections(mesh, mesh.vertex_sets["clamped"], 24)
