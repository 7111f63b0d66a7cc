"""A law of the membrane on all degrees of freedom of a shell, and how far its reduced wall is from that."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction import reduce_duct
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import fetch_samples
from trocar.services.mechanics.reduction.hyperelastic.equilibrium import rest_shape
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane

#: Parts in which a load comes on, and what is left of it, as a share, at the end of a part: only where the last ends is
#: asked for, and those before have to lead there.
PARTS, LEFT_BEFORE, LEFT = 4, 1e-2, 1e-7


def straight_axis(middle_m):
    """Direction (m, 3) of the axis of a duct along x."""
    return np.broadcast_to((1.0, 0.0, 0.0), middle_m.shape)


def strain_of_all(model, law, axis_at):
    """The law's strain (3 m, f) per free degree of freedom, and each triangle's modulus times volume.

    A law of the linear wall's form takes y with y . y = e D e / E, another the strain along the axis and round it.
    ``axis_at`` returns the axis' directions (m, 3) beside points (m, 3).
    """
    membrane, n, section = Membrane.from_model(model), model.mesh.n_triangles, model.section
    corners = model.mesh.vertices_m[model.mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    energy_j = 0.5 * section.youngs_modulus_pa * section.thickness_m * np.linalg.norm(normal, axis=1)
    if law.row.is_of_linear_form:
        taken = np.linalg.cholesky(membrane.rigidity_n_m / energy_j[:, None, None]).transpose(0, 2, 1)
    else:
        taken = turned_to_axis(membrane.tangents, axis_at(corners.mean(axis=1)))
    # Strain ab of a triangle by its corner n along i: t_a,i dN_n / dx_b.
    mixed = np.einsum("mai,mbn->mabni", membrane.tangents, membrane.gradients)
    strain = np.stack([mixed[:, 0, 0], mixed[:, 1, 1], mixed[:, 0, 1] + mixed[:, 1, 0]], axis=1)
    strain = np.einsum("mcd,mdni->mcni", taken, strain)
    rows = np.broadcast_to(np.arange(3 * n).reshape(n, 3, 1, 1), strain.shape)
    columns = np.broadcast_to(6 * model.mesh.triangles[:, None, :, None] + np.arange(3), strain.shape)
    full = sp.coo_array((strain.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n, model.n_dofs))
    return full.tocsc()[:, model.free_dofs].tocsr(), energy_j


def turned_to_axis(tangents, axis):
    """Matrices (m, 3, 3) that make strains along the axis (m, 3) of those in the triangles' frames (m, 2, 3)."""
    c, s = np.moveaxis(np.einsum("mai,mi->am", tangents, axis), 0, 0)
    size = np.hypot(c, s)
    c, s = c / size, s / size
    rows = [c * c, s * s, c * s], [s * s, c * c, -c * s], [-2.0 * c * s, 2.0 * c * s, c * c - s * s]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def at_rest(model, law, load, axis_at):
    """Displacement (n, 3) at rest of all degrees of freedom, by Newton's method in steps of the load."""
    B, energy_j = strain_of_all(model, law, axis_at)
    K, whole = model.K_free, free_load(model, load)
    u = np.zeros(len(whole))
    for part in np.linspace(1.0 / PARTS, 1.0, PARTS):
        most = LEFT if part == 1.0 else LEFT_BEFORE
        for _ in range(50):
            _, stress, tangent = law.respond((B @ u).reshape(-1, 3))
            left = part * whole - K @ u - B.T @ (energy_j[:, None] * stress).ravel()
            if np.linalg.norm(left) < most * np.linalg.norm(whole):
                break
            stiff = sp.block_diag([sp.coo_array(each) for each in energy_j[:, None, None] * tangent], format="csr")
            u = u + factorise((K + B.T @ stiff @ B).tocsc()).solve(left)
        else:
            raise AssertionError("no equilibrium")
    return nodal_translations(model, u)


def errors(recipe, law, load, cache_dir, axis_at=straight_axis):
    """Of the displacement, and of the work of the load, over those of all degrees of freedom."""
    recipe = replace(recipe, stretch_law=law)
    duct, model = reduce_duct(recipe, 0.1, cache_dir), recipe.model()
    basis, samples = duct.basis, fetch_samples(recipe, duct.basis, law, cache_dir)
    modal = np.einsum("nar,na->r", basis.Phi, load)
    linear = model.solve_static(load).displacement_m
    left_out = linear - basis.displacements(modal / basis.omega_rad_s**2)
    q = rest_shape(samples.strain, samples.energy_j, law, basis.omega_rad_s, modal)
    moved, expected = basis.displacements(q) + left_out, at_rest(model, law, load, axis_at)
    error = np.linalg.norm(moved - expected) / np.linalg.norm(expected)
    work, of_linear = (np.sum(load * each) / np.sum(load * expected) - 1.0 for each in (moved, linear))
    print(
        f"{basis.n_modes} modes: displacement {100.0 * error:.2f} %, work {100.0 * work:+.2f} %, "
        f"of a linear wall {100.0 * of_linear:+.1f} %"
    )
    return error, abs(work)
