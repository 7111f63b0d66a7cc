"""Section of the shell: thickness, elastic moduli and density, uniform or given per triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray


@dataclass(frozen=True)
class Orthotropy:
    """A stiffer and a softer direction in the plane of the wall.

    ``youngs_modulus_pa`` and ``poisson_ratio`` of the section then mean E1 and nu12, along the axis.

    Attributes:
        axis: (3,) or (m, 3) material direction 1 in global components, projected into each triangle's plane.
        modulus_ratio: E2 / E1, stiffness across the axis over stiffness along it.
        shear_modulus_ratio: G12 / E1.
    """

    axis: FloatArray
    modulus_ratio: float
    shear_modulus_ratio: float


@dataclass(frozen=True)
class ShellSection:
    """Thickness and material; every field is a number or an array with one value per triangle."""

    thickness_m: float | FloatArray
    youngs_modulus_pa: float | FloatArray
    poisson_ratio: float | FloatArray
    density_kg_m3: float | FloatArray
    orthotropy: Orthotropy | None = None

    def __post_init__(self) -> None:
        for name in ("thickness_m", "youngs_modulus_pa", "density_kg_m3"):
            value = np.asarray(getattr(self, name))
            if not (np.isfinite(value).all() and (value > 0.0).all()):
                raise ValueError(f"section: {name} must be positive everywhere")
        nu = np.asarray(self.poisson_ratio)
        ratio = self.orthotropy.modulus_ratio if self.orthotropy else 1.0
        if self.orthotropy and not (ratio > 0.0 and self.orthotropy.shear_modulus_ratio > 0.0):
            raise ValueError("section: orthotropy ratios must be positive")
        if not (np.isfinite(nu).all() and (nu**2 * ratio < 1.0).all() and (nu > -1.0).all()):
            raise ValueError("section: poisson_ratio must keep 1 - nu12 nu21 positive")
        if self.orthotropy is None and (nu > 0.5).any():
            raise ValueError("section: poisson_ratio of an isotropic material must not exceed 0.5")

    def per_triangle(self, name: str, n_triangles: int) -> FloatArray:
        """(m,) values of one field.

        Raises ValueError if the array given has another length than the mesh has triangles.
        """
        value = np.asarray(getattr(self, name), dtype=np.float64)
        if value.ndim and value.shape != (n_triangles,):
            raise ValueError(f"section: {name} has shape {value.shape}, the mesh has {n_triangles} triangles")
        return np.broadcast_to(value, (n_triangles,))


def plane_stress_matrices(section: ShellSection, frames: FloatArray) -> FloatArray:
    """(m, 3, 3) stress per strain (xx, yy, engineering xy) in Pa, in each triangle's local frame."""
    n = len(frames)
    E1 = section.per_triangle("youngs_modulus_pa", n)
    nu = section.per_triangle("poisson_ratio", n)
    D = np.zeros((n, 3, 3))
    if section.orthotropy is None:
        D[:, 0, 0] = D[:, 1, 1] = E1 / (1.0 - nu**2)
        D[:, 0, 1] = D[:, 1, 0] = nu * D[:, 0, 0]
        D[:, 2, 2] = E1 / (2.0 * (1.0 + nu))
        return D
    ratio = section.orthotropy.modulus_ratio
    D[:, 0, 0] = E1 / (1.0 - nu**2 * ratio)
    D[:, 1, 1] = ratio * D[:, 0, 0]
    D[:, 0, 1] = D[:, 1, 0] = nu * D[:, 1, 1]
    D[:, 2, 2] = section.orthotropy.shear_modulus_ratio * E1
    T = strain_rotation(axis_in_plane(section.orthotropy.axis, frames))
    rotated: FloatArray = T.transpose(0, 2, 1) @ D @ T
    return rotated


def axis_in_plane(axis: FloatArray, frames: FloatArray) -> FloatArray:
    """(m, 2) unit material direction 1 in local components."""
    axes = np.broadcast_to(np.asarray(axis, np.float64), (len(frames), 3))
    local = np.einsum("mij,mj->mi", frames[:, :2], axes)
    length = np.linalg.norm(local, axis=1)
    lost = length <= 1e-6 * np.linalg.norm(axes, axis=1)
    if lost.any():
        raise ValueError(
            f"section: the orthotropy axis is normal to triangle {int(np.flatnonzero(lost)[0])}, it has no "
            "direction in the wall there"
        )
    direction: FloatArray = local / length[:, None]
    return direction


def strain_rotation(direction: FloatArray) -> FloatArray:
    """(m, 3, 3) strain in material axes from strain in local axes, engineering shear."""
    c, s = direction.T
    T = np.empty((len(direction), 3, 3))
    T[:, 0] = np.stack([c * c, s * s, c * s], axis=1)
    T[:, 1] = np.stack([s * s, c * c, -c * s], axis=1)
    T[:, 2] = np.stack([-2.0 * c * s, 2.0 * c * s, c * c - s * s], axis=1)
    return T
