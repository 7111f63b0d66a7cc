"""Solve a ``trocar fem`` case: build the model, statics and modes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import (
    EigenModes,
    ElementChoice,
    Orthotropy,
    ShellModel,
    ShellSection,
    StaticSolution,
    Support,
    compute_modes,
    pressure_load,
)
from trocar.services.mechanics.fem.boundary_conditions import DOF_NAMES, held_dofs
from trocar.services.mechanics.fem.memory import check_memory
from trocar.services.mechanics.fem.nonlinear import (
    CorotationalShell,
    NonlinearLoad,
    PathPoint,
    PathSettings,
    trace_path,
)
from trocar.services.mechanics.surface.mesh import TriangleMesh, unique_edges
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.loading import SurfaceSettings, load_duct_surface
from trocar.services.meshes.reading import read_surface
from trocar.services.meshes.repairing import merge_and_drop
from trocar.services.meshes.winding import flipped_edges, wind_consistently
from trocar.studies.fem.arc_length import MOST_POINTS, trace_arc_length
from trocar.studies.fem.buckling import BucklingModes, compute_buckling
from trocar.studies.fem.case import FemCase, Held, Load
from trocar.studies.fem.cautions import find_cautions
from trocar.studies.fem.floating import Floating, compute_floating_modes, find_floating
from trocar.studies.fem.loads import surface_load
from trocar.studies.fem.outward import face_outwards
from trocar.studies.fem.select import place_mm, select
from trocar.studies.published.panel import Annulus, Cylinder, Plate, Sphere

OnStage = Callable[[str, int], None]
"""Told the name of a stage and how many steps it is expected to take; then called with "" and 1 a step."""

MOST_TURNED = 0.25
"""Part of a sheet's area that may be wound against the rest; beyond it the file does not say which side is out."""
POINTS_A_STEP = 10
"""Of a path along its length: none of its steps is longer than a load step."""


def _silent(stage: str, steps: int) -> None:
    """Follow nothing."""


@dataclass(frozen=True)
class FemResult:
    """Everything a case was solved for."""

    case: FemCase
    model: ShellModel
    actions: list[str]
    cautions: list[str]
    """What to keep in mind when reading the numbers."""
    static: StaticSolution | None
    modes: EigenModes | None
    buckling: BucklingModes | None
    path: list[PathPoint]
    """Equilibria of a nonlinear analysis, up to the full load; empty if it is linear."""


def solve_case(case: FemCase, folder: Path, on_stage: OnStage = _silent) -> FemResult:
    """Solve a case whose file lies in ``folder``, from where relative mesh paths count.

    Raises ValueError: one sentence that names the key, the mesh file or the place that is wrong.
    """
    try:
        return _solve(case, folder, on_stage)
    except ValueError as error:
        raise ValueError(_in_keys_of_the_file(str(error))) from error


PANELS = {"plate": Plate, "annulus": Annulus, "cylinder": Cylinder, "sphere": Sphere}
"""What builds a mesh of the key's name."""
_KEYS_OF_THE_FILE = (
    ("duct: ", "mesh.parametric: "),
    *((f"{name}: ", f"mesh.{name}: ") for name in PANELS),
    ("wall_thickness_m", "thickness_m"),
    ("section: thickness_m", "thickness_m:"),
    ("section: ", "material: "),
    ("n_modes", "modes:"),
    ("arc-length control", "path: arc_length"),
    ("n_steps", "load_steps"),
)
"""What the solver calls what a file says, and what the file calls it; as words, for a path may hold them as parts."""


def _in_keys_of_the_file(sentence: str) -> str:
    for ours, theirs in _KEYS_OF_THE_FILE:
        ends = "" if ours.endswith(" ") else r"(?![\w/-]|\.\w)"
        sentence = re.sub(rf"(?<![\w./-]){ours}{ends}", theirs, sentence)
    return sentence


def _solve(case: FemCase, folder: Path, on_stage: OnStage) -> FemResult:
    on_stage("mesh", 1)
    mesh, actions = build_mesh(case, folder, on_stage)
    on_stage("assembly", 1)
    model, imposed, floating = build_model(case, mesh)
    for name, where in case.probes.items():
        select(mesh, where, f"probes.{name}")
    on_stage("factors", 1)
    _ = model.factor
    static, path = None, []
    if case.analysis == "nonlinear":
        path = _trace(case, model, imposed, on_stage)
    elif case.loads or imposed.any():
        on_stage("static solution", 1)
        static = model.solve_static(build_load(case, model), imposed)
    modes = None
    if case.modes:
        on_stage("modes", 3 * case.modes + 20)
        with _naming("modes"):
            modes = _modes(case, model, floating, lambda: on_stage("", 1))
    buckling = None
    if case.buckling and static is not None:
        on_stage("buckling", 1)
        pressure_pa = sum(load.pressure_pa or 0.0 for load in case.loads)
        with _naming("buckling"):
            buckling = compute_buckling(model, static, case.buckling, pressure_pa)
    cautions = [*find_cautions(case, model, static, path), *_about_freedom(floating)]
    return FemResult(case, model, actions, cautions, static, modes, buckling, path)


def _trace(case: FemCase, model: ShellModel, imposed: FloatArray, on_stage: OnStage) -> list[PathPoint]:
    """The path from nothing to all loads; its bar advances with the load."""
    pressure_pa = 0.0
    for k, part in enumerate(case.loads):
        if part.pressure_pa is not None:
            _refuse_sideless(model.mesh, f"loads.{k}.pressure_pa")
            pressure_pa += part.pressure_pa
    dead = tuple(part for part in case.loads if part.pressure_pa is None)
    load = NonlinearLoad(build_load(case.model_copy(update={"loads": dead}), model), pressure_pa, imposed)
    if not (load.dead.any() or pressure_pa or imposed.any()):
        raise ValueError("loads: add up to nothing, and no support is moved: there is no path to follow")
    if not (load.dead.ravel()[model.free_dofs].any() or pressure_pa or imposed.any()):
        raise ValueError(
            "loads: act only where supports hold them; vertices of a file that coincide are one, a slit needs a gap"
        )
    on_stage("path", case.load_steps)
    done = 0

    def advance(point: PathPoint) -> None:
        nonlocal done
        while done < min(round(point.part * case.load_steps), case.load_steps - 1):
            done += 1
            on_stage("", 1)

    shell, settings = CorotationalShell(model), PathSettings(case.load_steps)
    if case.path == "load":
        return trace_path(shell, load, settings, advance)
    return trace_arc_length(shell, load, settings, advance, max(MOST_POINTS, POINTS_A_STEP * case.load_steps))


def _about_freedom(floating: Floating) -> list[str]:
    n = len(floating.pins)
    return [f"the supports leave {n} rigid motions: they are the first modes, at 0 Hz"] if n else []


def _modes(case: FemCase, model: ShellModel, floating: Floating, on_solve: Callable[[], None]) -> EigenModes:
    if len(floating.pins):
        return compute_floating_modes(model, floating, case.modes, on_solve)
    return compute_modes(model, case.modes, on_solve)


@contextmanager
def _naming(key: str) -> Iterator[None]:
    """Make an iteration that gives up a sentence about the key that asked for it."""
    try:
        yield
    except ArpackNoConvergence as error:
        found = len(error.eigenvalues)
        raise ValueError(f"{key}: the iteration gave up with {found} found to rounding; ask for fewer") from error


def build_mesh(case: FemCase, folder: Path, on_stage: OnStage = _silent) -> tuple[TriangleMesh, list[str]]:
    """The case's mesh, and what was done to a file to get it."""
    source = case.mesh
    if source.parametric is not None:
        return parametric_duct(DuctGeometry(**source.parametric.model_dump(), wall_thickness_m=case.thickness_m)), []
    for name, panel in PANELS.items():
        if (given := getattr(source, name)) is not None:
            return panel(**given.model_dump()).mesh(), []
    if source.duct_file is not None:
        settings = source.duct_file.model_dump(exclude={"path"})
        path = folder / source.duct_file.path
        duct = load_duct_surface(path, SurfaceSettings(**settings), lambda step: on_stage(f"mesh: {step}", 1))
        return duct.mesh, duct.actions
    actions: list[str] = []
    if source.surface_file is None:
        raise ValueError("mesh: says nothing of where triangles come from")
    raw = read_surface(folder / source.surface_file.path, source.surface_file.units, actions)
    check_memory(raw.n_triangles // 2)  # so many vertices has a closed surface; a file may name each once a triangle
    try:
        merged = merge_and_drop(raw, actions)
    except MeshError as error:
        raise MeshError(f"{folder / source.surface_file.path}: {error}") from error
    return face_outwards(wind_consistently(merged, actions, MOST_TURNED), actions), actions


def build_model(case: FemCase, mesh: TriangleMesh) -> tuple[ShellModel, FloatArray, Floating]:
    """The supported model, the (n, 6) displacements imposed on its held dofs, and what it may do rigidly.

    Only a case that asks for nothing but modes may float: then the model is pinned, as `find_floating` says.
    """
    supports = []
    imposed = np.zeros((mesh.n_vertices, 6))
    held_by = np.full((mesh.n_vertices, 6), -1, np.int32)
    for k, held in enumerate(case.supports):
        vertices = select(mesh, held.where, f"supports.{k}.where")
        supports.append(Support(vertices, held.dofs))
        _impose(held, k, vertices, imposed, held_by, mesh)
    elements = ElementChoice(case.elements.membrane, case.elements.bending)
    floating = Floating(np.zeros((6 * mesh.n_vertices, 0)), np.zeros(0, np.int32))
    if not case.loads and not imposed.any() and case.constraints == "elimination":
        floating = find_floating(mesh, held_dofs(mesh, supports))
        supports += [Support(np.array([dof // 6]), (DOF_NAMES[dof % 6],)) for dof in floating.pins]
    return ShellModel(mesh, _section(case, mesh), supports, elements, case.constraints), imposed, floating


def _impose(held: Held, k: int, vertices: IntArray, imposed: FloatArray, held_by: IntArray, mesh: TriangleMesh) -> None:
    """Write support ``k`` into ``imposed`` and ``held_by``, unless it contradicts itself or an earlier one."""
    for component, value in enumerate(held.displacement_m):
        dof = DOF_NAMES[component]
        if dof not in held.dofs:
            if value:
                raise ValueError(f"supports.{k}.displacement_m: {dof} is moved by {value} m, but dofs does not hold it")
            continue
        at_odds = vertices[(held_by[vertices, component] >= 0) & (imposed[vertices, component] != value)]
        if len(at_odds):
            vertex, first = int(at_odds[0]), held_by[at_odds[0], component]
            raise ValueError(
                f"supports.{k}.displacement_m: {dof} of vertex {vertex} at {place_mm(mesh, vertex)} is held at "
                f"{value} m here and at {imposed[vertex, component]} m by supports.{first}"
            )
        imposed[vertices, component] = value
        held_by[vertices, component] = k


def _section(case: FemCase, mesh: TriangleMesh) -> ShellSection:
    centres = mesh.vertices_m[mesh.triangles].mean(axis=1)
    thickness = np.full(mesh.n_triangles, case.thickness_m)
    modulus = np.full(mesh.n_triangles, case.material.youngs_modulus_pa)
    for k, region in enumerate(case.regions):
        inside = np.linalg.norm(centres - region.centre_m, axis=1) < region.radius_m
        if not inside.any():
            raise ValueError(f"regions.{k}: no triangle has its centre within radius_m of centre_m")
        with np.errstate(over="ignore"):  # the section refuses what has become infinite
            thickness[inside] *= region.thickness_factor
            modulus[inside] *= region.modulus_factor
    given = case.material.orthotropy
    orthotropy = (
        None if given is None else Orthotropy(np.array(given.axis), given.modulus_ratio, given.shear_modulus_ratio)
    )
    return ShellSection(thickness, modulus, case.material.poisson_ratio, case.material.density_kg_m3, orthotropy)


def build_load(case: FemCase, model: ShellModel) -> FloatArray:
    """(n, 6) sum of all loads of the case, forces and moments."""
    total = np.zeros((model.mesh.n_vertices, 6))
    for k, load in enumerate(case.loads):
        if load.moment_n_m is not None and load.where is not None:
            vertices = select(model.mesh, load.where, f"loads.{k}.where")
            total[vertices, 3:] += np.array(load.moment_n_m) / len(vertices)
        else:
            total[:, :3] += _nodal(load, model, f"loads.{k}")
    return total


def _nodal(load: Load, model: ShellModel, key: str) -> FloatArray:
    mesh = model.mesh
    if load.pressure_pa is not None:
        _refuse_sideless(mesh, f"{key}.pressure_pa")
        return pressure_load(mesh, load.pressure_pa)
    if load.traction_pa is not None:
        return surface_load(mesh, np.array(load.traction_pa))
    if load.acceleration_m_s2 is not None:
        return np.outer(model.mass_kg, load.acceleration_m_s2)
    nodal = np.zeros((mesh.n_vertices, 3))
    if load.where is not None:
        vertices = select(mesh, load.where, f"{key}.where")
        nodal[vertices] = np.array(load.force_n) / len(vertices)
    return nodal


def _refuse_sideless(mesh: TriangleMesh, key: str) -> None:
    """A pressure needs an outward side everywhere."""
    edges, shared = unique_edges(mesh)
    flipped = flipped_edges(mesh)
    for bad, why in ((edges[shared > 2], "more than two triangles meet"), (flipped, "two triangles are wound apart")):
        if len(bad):
            place_mm = np.round(1e3 * mesh.vertices_m[bad[0]].mean(axis=0), 2).tolist()
            raise ValueError(f"{key}: the surface has no outward side, at {place_mm} mm {why}")
