"""The strain that a law of the membrane takes: of all triangles of a wall, and of all its degrees of freedom."""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.fem.frames import local_frames
from trocar.services.mechanics.fem.section import axis_in_plane, strain_rotation
from trocar.services.mechanics.reduction.hyperelastic.stretch_loads import axial_directions
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane
from trocar.services.mechanics.surface.mesh import triangle_areas_m2


def taken_strain(model: ShellModel, law: BeyondLinear) -> tuple[FloatArray, FloatArray]:
    """Return what a law makes of the strain in a triangle's frame (m, 3, 3), and modulus times volume (m,), in J."""
    n = model.mesh.n_triangles
    thickness, modulus = (model.section.per_triangle(name, n) for name in ("thickness_m", "youngs_modulus_pa"))
    energy_j: FloatArray = modulus * thickness * triangle_areas_m2(model.mesh)
    if law.row.is_of_linear_form:
        rigidity = Membrane.from_model(model).rigidity_n_m
        root = np.asarray(np.linalg.cholesky(rigidity / energy_j[:, None, None]), np.float64)
        return root.transpose(0, 2, 1), energy_j
    return strain_rotation(axis_in_plane(_axis(model), local_frames(model.mesh))), energy_j


def strain_of_freedoms(model: ShellModel, law: BeyondLinear) -> scipy.sparse.csr_array:
    """Return the law's strains of all triangles per free degree of freedom, (3 m, f)."""
    membrane, taken, m = Membrane.from_model(model), taken_strain(model, law)[0], model.mesh.n_triangles
    # Strain ab of a triangle by its corner n along i is t_a,i dN_n / dx_b.
    mixed = np.einsum("mai,mbn->mabni", membrane.tangents, membrane.gradients)
    strain = np.stack([mixed[:, 0, 0], mixed[:, 1, 1], mixed[:, 0, 1] + mixed[:, 1, 0]], axis=1)
    strain = np.einsum("mcd,mdni->mcni", taken, strain)
    rows = np.broadcast_to(np.arange(3 * m).reshape(m, 3, 1, 1), strain.shape)
    columns = np.broadcast_to(6 * model.mesh.triangles[:, None, :, None] + np.arange(3), strain.shape)
    whole = scipy.sparse.coo_array((strain.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * m, model.n_dofs))
    return whole.tocsc()[:, model.free_dofs].tocsr()


def _axis(model: ShellModel) -> FloatArray:
    """(3,) or (m, 3) the axis of the material, or of the wall where the material has none."""
    if model.section.orthotropy is not None:
        return model.section.orthotropy.axis
    axis: FloatArray = axial_directions(model)[model.mesh.triangles].sum(axis=1)
    return axis
