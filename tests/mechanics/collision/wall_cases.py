"""Small ducts of every kind that walls are placed by, and where their nodes are by brute force."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from trocar.services.mechanics.collision.placed_wall import (
    NO_LOADS,
    Loads,
    PlacedWall,
    configure,
    copy_configuration,
    place_requested,
    request_node,
)
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.compiled.struct import reader
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.reduction import ReducedDuct, Residual
from trocar.services.mechanics.reduction.build import build_basis, fill_full_residual
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from trocar.services.mechanics.reduction.residual.cyclic_residual import build_cyclic
from trocar.services.mechanics.surface.cyclic_symmetry import find_cyclic_symmetry
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

GEOMETRY = DuctGeometry(4e-3, 40e-3, 16, 26)
N_MODES, DENSITY, DAMPING = 24, 1060.0, 0.05
wall_at = reader(PlacedWall)
KINDS = "straight", "cyclic", "turned"


@cache
def modes_only(geometry: DuctGeometry) -> ReducedDuct:
    """Return a duct of this shape whose residual is left out."""
    mesh = parametric_duct(geometry)
    model = ShellModel(mesh, ShellSection(0.5e-3, 60e3, 0.45, DENSITY), [clamp(mesh)], ElementChoice("cst", "dkt"))
    return ReducedDuct(mesh, build_basis(model, N_MODES), Residual.none(mesh.n_vertices), np.full(N_MODES, DAMPING))


@cache
def wall(kind: str) -> ReducedDuct:
    """Return a soft duct of 432 nodes whose residual is kept, or whose sections turn, as ``kind`` says."""
    mesh = parametric_duct(GEOMETRY)
    model = ShellModel(mesh, ShellSection(0.5e-3, 60e3, 0.45, DENSITY), [clamp(mesh)], ElementChoice("cst", "dkt"))
    basis = build_basis(model, N_MODES)
    if kind == "cyclic":
        symmetry = find_cyclic_symmetry(mesh)
        blocks, odd = build_cyclic(model, basis, symmetry)
        residual = Residual.cyclic(symmetry, blocks.astype(np.float32), odd)
    else:
        full = np.zeros((basis.n_nodes, basis.n_nodes, 3, 3), np.float32)
        fill_full_residual(model, basis, full)
        residual = Residual.full(full)
    duct = ReducedDuct(mesh, basis, residual, np.full(N_MODES, DAMPING))
    return (
        replace(duct, warp=TubeWarp.from_basis(mesh, basis, mesh.vertex_sets["clamped"])) if kind == "turned" else duct
    )


def coordinates(duct: ReducedDuct, rng: np.random.Generator, size_m: float) -> NDArray[np.float64]:
    """Return coordinates of all modes that move the furthest node by about so much."""
    q = rng.standard_normal(N_MODES) / duct.basis.omega_rad_s
    return q * (size_m / np.linalg.norm(duct.basis.displacements(q), axis=1).max())


def placed(duct: ReducedDuct, q: NDArray[np.float64], loads: Loads) -> NDArray[np.float64]:
    """Return where all nodes are (n, 3), from the whole residual and, where sections turn, from the warp."""
    every, extra = np.arange(duct.mesh.n_vertices, dtype=np.int32), np.zeros((duct.mesh.n_vertices, 3))
    if duct.warp is None:
        duct.residual.apply(*loads, every, extra)
        return duct.mesh.vertices_m + duct.basis.displacements(q) + extra
    frame, turn, at = SectionFrame(duct.warp), np.empty((len(every), 3, 3)), np.empty((len(every), 3))
    frame.update(q)
    frame.node_rotations(every, turn)
    back = np.einsum("kji,kj->ki", turn[loads[0]], loads[1])
    duct.residual.apply(loads[0], back, every, extra)
    frame.node_positions(every, extra, at)
    return at


def set_configuration(wall: PlacedWall, q: NDArray[np.float64], loads: Loads, lasting: Loads = NO_LOADS) -> float:
    """Set a wall's coordinates and loads, and return a bound on its motion."""
    moved_m: float = _configure(wall.address, q, loads, lasting)
    return moved_m


def place(wall: PlacedWall, nodes: NDArray[np.int32] | None = None) -> None:
    """Place these nodes of a wall, or all."""
    _place(wall.address, np.arange(len(wall.rest), dtype=np.int32) if nodes is None else nodes)


def follow(wall: PlacedWall, other: PlacedWall) -> None:
    """Copy the configuration of another wall."""
    _follow(wall.address, other.address)


@building_kernel
def _configure(address, q, loads, lasting):
    return configure(wall_at(address), q, loads, lasting)


@building_kernel
def _place(address, nodes):
    for node in nodes:
        request_node(wall_at(address), node)
    place_requested(wall_at(address))


@building_kernel
def _follow(address, other):
    copy_configuration(wall_at(address), wall_at(other))
