"""Results of a ``trocar fem`` case for programs (JSON) and for ParaView (VTU)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.fem import StaticSolution
from services.meshes.writing import write_vtu
from services.studies.fem_run import FemResult, select


def to_json(result: FemResult) -> dict[str, Any]:
    """Plain data: sizes, displacements, reactions, frequencies, load factors, and the probes by name; SI units."""
    mesh = result.model.mesh
    data: dict[str, Any] = {
        "mesh": {
            "vertices": mesh.n_vertices,
            "triangles": mesh.n_triangles,
            "free_dofs": len(result.model.free_dofs),
            "mass_kg": float(result.model.mass_kg.sum()),
            "vertex_sets": {name: len(ids) for name, ids in mesh.vertex_sets.items()},
            "actions": result.actions,
        },
        "cautions": result.cautions,
    }
    if result.static is not None:
        data["static"] = _static_json(result, result.static)
    if result.modes is not None:
        data["frequency_hz"] = result.modes.frequency_hz.tolist()
    if result.buckling is not None:
        data["load_factor"] = result.buckling.load_factor.tolist()
    return data


def _static_json(result: FemResult, static: StaticSolution) -> dict[str, Any]:
    mesh = result.model.mesh
    force = static.reaction[:, :3]
    moment = np.cross(mesh.vertices_m, force) + static.reaction[:, 3:]
    length = np.linalg.norm(static.displacement_m, axis=1)
    return {
        "residual": static.residual,
        "condition": result.model.condition,
        "largest_displacement_m": float(length.max()),
        "largest_displacement_vertex": int(length.argmax()),
        "reaction_force_n": force.sum(axis=0).tolist(),
        "reaction_moment_about_origin_n_m": moment.sum(axis=0).tolist(),
        "probes": {
            name: static.displacement_m[select(mesh, where, f"probes.{name}")].mean(axis=0).tolist()
            for name, where in result.case.probes.items()
        },
        "displacement_m": static.displacement_m.tolist(),
    }


def save_vtu(result: FemResult, path: Path) -> None:
    """Write displacements, rotations, reactions, mode and buckling shapes (largest translation 1) for ParaView."""
    model = result.model
    fields: dict[str, FloatArray] = {}
    if result.static is not None:
        fields["displacement_m"] = result.static.displacement_m
        fields["rotation_rad"] = result.static.rotation_rad
        fields["reaction_force_n"] = np.ascontiguousarray(result.static.reaction[:, :3])
    if result.modes is not None:
        for k, frequency in enumerate(result.modes.frequency_hz):
            shape = np.ascontiguousarray(result.modes.Phi[:, :, k])
            fields[f"mode {k + 1}: {frequency:.4g} Hz"] = shape / np.linalg.norm(shape, axis=1).max()
    if result.buckling is not None:
        for k, factor in enumerate(result.buckling.load_factor):
            fields[f"buckling {k + 1}: {factor:.4g} x load"] = np.ascontiguousarray(result.buckling.Phi[:, :, k])
    section = model.section
    per_triangle = {
        name: np.array(section.per_triangle(name, model.mesh.n_triangles))
        for name in ("thickness_m", "youngs_modulus_pa")
    }
    write_vtu(path, model.mesh, fields, per_triangle)
