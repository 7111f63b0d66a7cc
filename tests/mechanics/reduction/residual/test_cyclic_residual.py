"""The residual compliance of one sector, turned, is that between all pairs of nodes: an independent way to the same."""

import numpy as np
import pytest

from tests.mechanics.reduction.residual.node_blocks import between_nodes
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.fem.section import Orthotropy
from trocar.services.mechanics.reduction import ReducedDuct, Residual
from trocar.services.mechanics.reduction.build import build_basis, fill_full_residual
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame
from trocar.services.mechanics.reduction.residual.cyclic_residual import build_cyclic, odd_modes
from trocar.services.mechanics.reduction.residual.rotated_residual import RotatedResidual
from trocar.services.mechanics.surface.cyclic_symmetry import find_cyclic_symmetry
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

GEOMETRY = DuctGeometry(4e-3, 24e-3, 16, 12, taper=0.2)
SECTION = ShellSection(0.8e-3, 100e3, 0.45, 1060.0, Orthotropy(np.array([1.0, 0.0, 0.0]), 2.0, 0.4))
WHOLE_PAIRS, HALF_A_PAIR = 20, 22


def made(n_modes):
    mesh = parametric_duct(GEOMETRY)
    model = ShellModel(mesh, SECTION, [clamp(mesh)], ElementChoice("andes", "dkt"))
    basis, symmetry = build_basis(model, n_modes), find_cyclic_symmetry(mesh)
    whole = np.zeros((basis.n_nodes, basis.n_nodes, 3, 3), np.float32)
    fill_full_residual(model, basis, whole)
    blocks, odd = build_cyclic(model, basis, symmetry)
    duct = ReducedDuct(mesh, basis, Residual.full(whole), np.full(n_modes, 0.05))
    return duct, Residual.cyclic(symmetry, blocks.astype(np.float32), odd)


@pytest.fixture(scope="module", params=[0, 1], ids=["whole pairs", "half a pair"])
def both(request):
    duct, cyclic = made((WHOLE_PAIRS, HALF_A_PAIR)[request.param])
    assert cyclic.store.odd.shape[2] == request.param
    return duct, cyclic


def test_a_basis_that_ends_between_two_of_a_pair_has_an_odd_mode_and_one_that_does_not_has_none():
    mesh = parametric_duct(GEOMETRY)
    model = ShellModel(mesh, SECTION, [clamp(mesh)], ElementChoice("andes", "dkt"))
    basis, symmetry = build_basis(model, 24), find_cyclic_symmetry(mesh)
    found = []
    for n_modes in range(8, 24):
        first = type(basis).from_modes(basis.omega_rad_s[:n_modes], basis.Phi[:, :, :n_modes])
        alike = abs(basis.omega_rad_s[n_modes] / basis.omega_rad_s[n_modes - 1] - 1.0) < 1e-6
        odd = odd_modes(model, first, symmetry)
        assert list(np.flatnonzero(odd)) == ([n_modes - 1] if alike else [])
        found.append(alike)
    assert {True, False} == set(found)


def test_blocks_between_any_nodes_are_those_between_all_pairs(both):
    duct, cyclic = both
    n = duct.basis.n_nodes
    every = np.arange(n, dtype=np.int32)
    found, wanted = between_nodes(cyclic, every), between_nodes(duct.residual, every)
    assert np.abs(found - wanted).max() < 2e-7 * np.abs(wanted).max()
    assert np.array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > -1e-6 * np.linalg.eigvalsh(found)[-1]


def test_points_and_loads_read_the_same_blocks(both):
    duct, cyclic = both
    rng = np.random.default_rng(5)
    corners = rng.choice(duct.mesh.triangles, 12, replace=False).astype(np.int32)
    weights, source = rng.dirichlet(np.ones(3), 12), np.arange(12, dtype=np.int32)
    loads = rng.choice(duct.basis.n_nodes, 9, replace=False).astype(np.int32), rng.normal(size=(9, 3))
    every = np.arange(duct.basis.n_nodes, dtype=np.int32)
    near, of_all = [], []
    for residual, out in ((cyclic, near), (duct.residual, of_all)):
        W, moved = np.empty((36, 36)), np.zeros((len(every), 3))
        residual.gather_points(corners, weights, W, source)
        residual.apply(*loads, every, moved)
        out += [W, moved]
    for found, wanted in zip(near, of_all, strict=True):
        assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()
        assert np.abs(wanted).max() > 0.0


def test_sections_turn_it_as_they_turn_that_between_all_pairs(both, monkeypatch):
    duct, cyclic = both
    rng = np.random.default_rng(6)
    turned = np.linalg.qr(rng.normal(size=(duct.basis.n_nodes, 3, 3)))[0]
    monkeypatch.setattr(SectionFrame, "node_rotations", lambda self, nodes, out: np.copyto(out, turned[nodes]))
    corners = rng.choice(duct.mesh.triangles, 8, replace=False).astype(np.int32)
    weights, source = rng.dirichlet(np.ones(3), 8), np.arange(8, dtype=np.int32)
    found, wanted = np.empty((24, 24)), np.empty((24, 24))
    frame = SectionFrame.__new__(SectionFrame)
    RotatedResidual.of(cyclic, frame, 8).gather_points(corners, weights, found, source)
    RotatedResidual.of(duct.residual, frame, 8).gather_points(corners, weights, wanted, source)
    assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_a_wall_that_is_thicker_on_one_side_is_refused():
    mesh = parametric_duct(GEOMETRY)
    thickness_m = np.where(mesh.vertices_m[mesh.triangles].mean(axis=1)[:, 1] > 0.0, 0.8e-3, 0.9e-3)
    model = ShellModel(mesh, ShellSection(thickness_m, 100e3, 0.45, 1060.0), [clamp(mesh)], ElementChoice())
    with pytest.raises(RuntimeError, match="not as symmetric as its mesh"):
        build_cyclic(model, build_basis(model, 12), find_cyclic_symmetry(mesh))


def test_blocks_of_another_shape_are_refused(both):
    _, cyclic = both
    symmetry = find_cyclic_symmetry(parametric_duct(GEOMETRY))
    with pytest.raises(ValueError, match=r"expected \(26, 26, 8, 3, 3\)"):
        Residual.cyclic(symmetry, cyclic.blocks, np.zeros((208, 3, 0)))
