"""Results of a ``trocar fem`` case for programs (JSON) and for ParaView (VTU)."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from trocar.services.files.atomic_file import atomic_file
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import StaticSolution
from trocar.services.mechanics.fem.boundary_conditions import DOF_NAMES
from trocar.services.mechanics.fem.nonlinear import PathPoint
from trocar.services.mechanics.fem.nonlinear.rotations import logarithm
from trocar.services.meshes.writing import write_vtu
from trocar.studies.fem.run import FemResult
from trocar.studies.fem.select import select


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
    if result.path:
        data["path"] = _path_json(result)
    return data


def _path_json(result: FemResult) -> dict[str, Any]:
    """Points of a nonlinear path, and the displacement of every vertex at its end."""
    start_m = result.model.mesh.vertices_m
    points = [
        {
            "part": point.part,
            "iterations": point.iterations,
            "residual": point.residual,
            **_equilibrium_json(result, point.at.position_m - start_m, point.reaction, point.at.position_m),
            "support_force_n": _support_forces(result, point.reaction),
        }
        for point in result.path
    ]
    end = result.path[-1].at.position_m - start_m
    return {"points": points, "displacement_m": end.tolist()}


def _equilibrium_json(
    result: FemResult, displacement: FloatArray, reaction: FloatArray, at_m: FloatArray
) -> dict[str, Any]:
    """Largest displacement, sum of the (n, 6) reactions, which act at ``at_m``, and the probes by name."""
    force = reaction[:, :3]
    moment = np.cross(at_m, force) + reaction[:, 3:]
    length = np.linalg.norm(displacement, axis=1)
    return {
        "largest_displacement_m": float(length.max()),
        "largest_displacement_vertex": int(length.argmax()),
        "reaction_force_n": force.sum(axis=0).tolist(),
        "reaction_moment_about_origin_n_m": moment.sum(axis=0).tolist(),
        "probes": {
            name: displacement[select(result.model.mesh, where, f"probes.{name}")].mean(axis=0).tolist()
            for name, where in result.case.probes.items()
        },
    }


def _support_forces(result: FemResult, reaction: FloatArray) -> list[list[float]]:
    """(3,) force of each support, out of the (n, 6) reactions: of the vertices that it names, along what it holds."""
    forces = []
    for k, support in enumerate(result.case.supports):
        vertices = select(result.model.mesh, support.where, f"supports.{k}.where")
        holds = [name in support.dofs for name in DOF_NAMES[:3]]
        forces.append(np.where(holds, reaction[vertices, :3].sum(axis=0), 0.0).tolist())
    return forces


def _static_json(result: FemResult, static: StaticSolution) -> dict[str, Any]:
    return {
        "residual": static.residual,
        "condition": result.model.condition,
        "support_force_n": _support_forces(result, static.reaction),
        **_equilibrium_json(result, static.displacement_m, static.reaction, result.model.mesh.vertices_m),
        "displacement_m": static.displacement_m.tolist(),
    }


def save_vtu(result: FemResult, path: Path) -> None:
    """Write displacements, rotations, reactions, mode and buckling shapes (largest translation 1) for ParaView.

    Frequencies and load factors are field data, ``mode_1_frequency_hz`` and so on; vertex sets are arrays of 0 and 1.

    A nonlinear path becomes one file a point, ``NAME-0000.vtu`` for the undeformed shell and so on, and ``path`` itself
    the last; ``NAME.pvd`` opens them as a series whose time is the part of the load.
    """
    if result.path:
        _save_series(result, path)
    model = result.model
    fields: dict[str, FloatArray] = {}
    constants: dict[str, float] = {}
    if result.static is not None:
        fields["displacement_m"] = result.static.displacement_m
        fields["rotation_rad"] = result.static.rotation_rad
        fields["reaction_force_n"] = np.ascontiguousarray(result.static.reaction[:, :3])
    if result.path:
        fields |= _path_fields(result, result.path[-1])
    if result.modes is not None:
        for k, frequency in enumerate(result.modes.frequency_hz):
            shape = np.ascontiguousarray(result.modes.Phi[:, :, k])
            fields[f"mode_{k + 1}"] = shape / np.linalg.norm(shape, axis=1).max()
            constants[f"mode_{k + 1}_frequency_hz"] = float(frequency)
    if result.buckling is not None:
        for k, factor in enumerate(result.buckling.load_factor):
            fields[f"buckling_{k + 1}"] = np.ascontiguousarray(result.buckling.Phi[:, :, k])
            constants[f"buckling_{k + 1}_load_factor"] = float(factor)
    section = model.section
    per_triangle = {
        name: np.array(section.per_triangle(name, model.mesh.n_triangles))
        for name in ("thickness_m", "youngs_modulus_pa")
    }
    write_vtu(path, model.mesh, fields, per_triangle, constants)


def _path_fields(result: FemResult, point: PathPoint) -> dict[str, FloatArray]:
    return {
        "displacement_m": point.at.position_m - result.model.mesh.vertices_m,
        "rotation_rad": logarithm(point.at.rotation),
        "reaction_force_n": np.ascontiguousarray(point.reaction[:, :3]),
    }


def _save_series(result: FemResult, path: Path) -> None:
    mesh = result.model.mesh
    zero = np.zeros_like(mesh.vertices_m)
    series = [(0.0, {"displacement_m": zero, "rotation_rad": zero, "reaction_force_n": zero})]
    series += [(point.part, _path_fields(result, point)) for point in result.path]
    collection = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    files = ElementTree.SubElement(collection, "Collection")
    for k, (part, fields) in enumerate(series):
        file = path.with_name(f"{path.stem}-{k:04d}.vtu")
        write_vtu(file, mesh, fields)
        ElementTree.SubElement(files, "DataSet", timestep=repr(part), file=file.name)
    with atomic_file(path.with_suffix(".pvd")) as half:
        ElementTree.ElementTree(collection).write(half, xml_declaration=True, encoding="utf-8")
