"""Torsion of a thick-walled tube: what flat facets and drilling freedoms make of it."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.published.shells import UNIT_DENSITY

POISSON_RATIO = 0.45


def tube_torsion(n_around: int, n_along: int, elements: ElementChoice, radius_over_thickness: float) -> float:
    """Torsional stiffness of a tube six radii long over the membrane's G 2 pi R³ h, from the twist of its middle half.

    A solid tube has 1 + h² / 4 R², Sanders's shell 1 + 3 h² / 16 R², a tube of ever narrower flat strips 1 + h² / 3 R².
    """
    E, radius = 1e5, 1.0
    length, thickness = 6.0 * radius, radius / radius_over_thickness
    mesh = parametric_duct(DuctGeometry(radius, length, n_around, n_along, wall_thickness_m=thickness))
    model = ShellModel(mesh, ShellSection(thickness, E, POISSON_RATIO, UNIT_DENSITY), [clamp(mesh)], elements)
    spokes = mesh.vertices_m * [0.0, 1.0, 1.0]
    rim = mesh.vertex_sets["mouth"]
    unit_moment = np.zeros((mesh.n_vertices, 3))
    unit_moment[rim] = np.cross([1.0, 0.0, 0.0], spokes[rim]) / (radius**2 * n_around)
    turn = np.cross(spokes, model.solve_static(unit_moment).displacement_m)[:, 0] / radius**2
    per_ring = turn.reshape(n_along + 1, n_around).mean(axis=1)
    near, far = n_along // 4, 3 * n_along // 4
    twist_per_length = (per_ring[far] - per_ring[near]) * n_along / ((far - near) * length)
    shear_modulus = E / (2.0 * (1.0 + POISSON_RATIO))
    return float(1.0 / (twist_per_length * shear_modulus * 2.0 * np.pi * radius**3 * thickness))
