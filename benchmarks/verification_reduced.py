"""Verification tables of the reduced duct: large deflections, stiffening, and the full model it stands for."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from verification_table import Entry, Table

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp
from trocar.services.mechanics.reduction import ModalBasis
from trocar.services.mechanics.reduction.build import build_basis, residual_response
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from trocar.services.mechanics.reduction.nonlinear.quadratic_manifold import relaxed_membrane_force
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_normals
from trocar.services.mechanics.surface.tube import DuctGeometry, alternating_triangles, parametric_duct

SZE = {2.0: (4.933, 1.604), 4.0: (6.698, 3.286)}
SZE_SOURCE = "Sze, Liu, Lo, FEAD 40:1551 (2004)"


def tables() -> list[Table]:
    return [large_deflections(), stiffening(), pinch()]


def strip(size: tuple[float, float], cells: tuple[int, int]) -> TriangleMesh:
    x, y = np.meshgrid(*(np.linspace(0.0, a, n + 1) for a, n in zip(size, cells, strict=True)), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    grid = np.arange(x.size).reshape(x.shape)
    return TriangleMesh(vertices, alternating_triangles(grid), {"clamped": grid[0], "tip": grid[-1]})


def large_deflections() -> Table:
    mesh = strip((10.0, 1.0), (40, 4))
    model = ShellModel(mesh, ShellSection(0.1, 1.2e6, 0.0, 1000.0), [clamp(mesh)], ElementChoice("andes", "dkt"))
    full_basis, entries = build_basis(model, 20), []
    for n_modes in (10, 20):
        basis = ModalBasis.from_modes(full_basis.omega_rad_s[:n_modes], full_basis.Phi[:, :, :n_modes])
        for load, (deflection, shortening) in SZE.items():
            tip = tip_under_end_shear(mesh, basis, load)
            label = f"40 x 4, r = {n_modes}"
            entries.append(Entry(f"end shear P = {load:g}, w", label, tip[2], deflection, SZE_SOURCE))
            entries.append(Entry(f"end shear P = {load:g}, -u", label, 10.0 - tip[0], shortening, SZE_SOURCE))
    about = (
        "Cantilever, L 10, W 1, t 0.1, E 1.2e6, nu 0, with r modes, by the effect `large_rotations`: linear modes "
        "with cross-sections that turn. The load keeps its direction. The linear answer to P = 4 is 13.33."
    )
    return Table("Reduced model: large deflections", about, entries)


def tip_under_end_shear(mesh: TriangleMesh, basis: ModalBasis, load_n: float) -> np.ndarray:
    tip = mesh.vertex_sets["tip"]
    share = np.full(tip.size, 1.0 / (tip.size - 1))
    share[[0, -1]] *= 0.5
    frame = SectionFrame(TubeWarp.from_basis(mesh, basis, mesh.vertex_sets["clamped"]))
    rows, nothing = np.empty((tip.size, 3, basis.n_modes)), np.zeros((tip.size, 3))
    positions = np.empty_like(nothing)

    def energy(scaled: np.ndarray) -> tuple[float, np.ndarray]:
        frame.update(scaled / basis.omega_rad_s)
        frame.node_positions(tip, nothing, positions)
        frame.node_rows(tip, nothing, rows)
        gradient = scaled - load_n * (share @ rows[:, 2]) / basis.omega_rad_s
        return 0.5 * scaled @ scaled - load_n * (share @ positions[:, 2]), gradient

    energy(minimize(energy, np.zeros(basis.n_modes), jac=True, method="BFGS", options={"gtol": 1e-7}).x)
    return share @ positions


def stiffening() -> Table:
    length, width, thickness, E = 1.0, 0.1, 0.01, 1e7
    mesh, entries = strip((length, width), (40, 2)), []
    ends = np.concatenate([mesh.vertex_sets["clamped"], mesh.vertex_sets["tip"]])
    hinges = Support(ends, ("ux", "uy", "uz"))
    model = ShellModel(mesh, ShellSection(thickness, E, 0.0, 1000.0), [hinges], ElementChoice("cst", "dkt"))
    basis = build_basis(model, 6)
    force = relaxed_membrane_force(model, basis, 1)
    for times in (1.0, 5.0, 10.0):
        amplitude, q = times * thickness, np.zeros(6)
        q[0] = amplitude / np.abs(basis.Phi[:, 2, 0]).max()
        expected = np.pi**4 * E * width * thickness * amplitude**4 / (32.0 * length**3)
        name = f"stretching energy at a = {times:g} t"
        entries.append(Entry(name, "40 x 2", force.energy_j(q), expected, "closed form", "J"))
    about = "Beam on immovable hinges, w = a sin(pi x / L): its stretching energy, pi⁴ EA a⁴ / (32 L³)."
    return Table("Reduced model: nonlinear membrane", about, entries)


def pinch() -> Table:
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 24, 36))
    model = ShellModel(mesh, ShellSection(0.5e-3, 100e3, 0.45, 1060.0), [clamp(mesh)], ElementChoice("andes", "dkt"))
    normals, entries = vertex_normals(mesh), []
    basis = build_basis(model, 60)
    for x_m in (10e-3, 20e-3, 36e-3):
        pair = [int(np.argmin(np.linalg.norm(mesh.vertices_m - [x_m, y, 0.0], axis=1))) for y in (4e-3, -4e-3)]
        forces = np.zeros((mesh.n_vertices, 3))
        forces[pair] = -1e-3 * normals[pair]
        full = model.solve_static(forces).displacement_m
        bare = basis.displacements(np.einsum("nir,ni->r", basis.Phi, forces) / basis.omega_rad_s**2)
        response = residual_response(model, basis, np.array(pair, np.int32), np.arange(2, dtype=np.int32))
        corrected = bare + np.einsum("ncij,cj->ni", response, forces[pair])
        for name, field in (("with residual", corrected), ("modes alone", bare)):
            depths = [-float(normals[pair[0]] @ u[pair[0]]) for u in (field, full)]
            quantity = f"pinch at {1e3 * x_m:g} mm, {name}"
            entries.append(Entry(quantity, "24 x 36, r = 60", *depths, "full model", "m"))
    about = (
        "Reference duct (R 4 mm, L 40 mm, t 0.5 mm). Two opposite nodes are pressed with 1 mN; the number is the "
        "depth of one of them."
    )
    return Table("Reduced model: pinch", about, entries)
