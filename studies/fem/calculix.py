"""A case as an input file of CalculiX, solved by it, and compared with our solution: linear statics and frequencies.

Each triangle becomes a shell of second order (S6) with the same corners and straight edges, so that both programs
solve the same faceted wall. Loads per area and mass become forces on the nodes, as the shape functions of such a
triangle have them: of an even load nothing on corners and a third on each middle of an edge. So no sign of a pressure,
and no normal that CalculiX finds, comes between the two.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.files.atomic_file import atomic_file
from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.boundary_conditions import DOF_NAMES
from trocar.services.mechanics.fem.shell_model import ShellModel
from trocar.services.mechanics.surface.mesh import edge_of_half_edges, triangle_area_vectors
from trocar.services.runtime.errors import ConfigError
from trocar.studies.fem.case import FemCase
from trocar.studies.fem.run import FemResult
from trocar.studies.fem.select import select

PROGRAM = "ccx"
LONGEST_S = 3600.0
NOTHING = 1e-6
"""Part of the largest displacement below which a displacement is rounding."""
MORE_MODES = 4
"""Modes that CalculiX is asked for beyond twice those that are compared: it may miss one of a pair among the last."""
_FEW = 12
"""Numbers in a row of an input file; CalculiX takes 16."""


@dataclass(frozen=True)
class Comparison:
    """Both solutions of a case.

    Attributes:
        displacement_m: (n, 3) of each vertex by CalculiX; None without a static solution.
        frequency_hz: (k,) by CalculiX; None without modes.
    """

    displacement_m: FloatArray | None
    frequency_hz: FloatArray | None


def check_case(case: FemCase) -> None:
    """Refuse what is not compared. Raises ConfigError that names the key."""
    for key, is_there, why in (
        ("analysis", case.analysis != "linear", "nonlinear paths are not compared"),
        ("buckling", case.buckling > 0, "buckling is not compared"),
        (
            "material.orthotropy",
            case.material.orthotropy is not None,
            "the axes of such a wall are not written",
        ),
    ):
        if is_there:
            raise ConfigError(f"{key}: does not go with --inp and --calculix: {why}")


def write_deck(result: FemResult, path: Path) -> None:
    """Write the case as an input file of CalculiX. The file is written whole or not at all."""
    with atomic_file(path) as half:
        half.write_text("".join(f"{line}\n" for line in _deck(result)), encoding="ascii")


def solve_by_calculix(result: FemResult) -> Comparison:
    """Solve the case of a result by CalculiX in a folder of its own.

    Raises ConfigError: it is not installed, or told nothing that can be compared.
    """
    program = shutil.which(PROGRAM)
    if program is None:
        raise ConfigError(f"--calculix: the program '{PROGRAM}' is not installed (Debian: calculix-ccx)")
    with tempfile.TemporaryDirectory(prefix="trocar-ccx-") as name:
        folder = Path(name)
        write_deck(result, folder / "case.inp")
        try:
            done = subprocess.run(
                [program, "case"], cwd=folder, capture_output=True, text=True, timeout=LONGEST_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise ConfigError(f"--calculix: {PROGRAM} took more than {LONGEST_S:g} s") from None
        told = _read(folder / "case.dat")
        n, found = result.model.mesh.n_vertices, None
        if result.static is not None:
            found = read_displacements(_read(folder / "case.frd"), n)
        frequencies = read_frequencies(told) if result.modes is not None else None
    errors = re.findall(r"\*ERROR[^\n]*", done.stdout)
    lacks = (result.static is not None and found is None) or (frequencies is not None and not len(frequencies))
    if lacks:
        said = errors[0] if errors else (done.stdout.strip().splitlines() or ["nothing"])[-1]
        raise ConfigError(f"--calculix: {PROGRAM} gave no solution; it said: {' '.join(said.split())[:200]}")
    return Comparison(found, frequencies)


def _read(path: Path) -> str:
    return path.read_text(encoding="ascii", errors="replace") if path.exists() else ""


def read_displacements(frd: str, n: int) -> FloatArray | None:
    """Return the displacements (n, 3) of the first n nodes in the first such block of a file, None if there is none."""
    begin = frd.find(" -4  DISP")
    if begin < 0:
        return None
    found = np.full((n, 3), np.nan)
    for line in frd[begin:].splitlines():
        if line.startswith(" -3"):
            break
        if line.startswith(" -1") and int(line[3:13]) <= n:
            found[int(line[3:13]) - 1] = [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)]
    return None if np.isnan(found).any() else found


def read_frequencies(dat: str) -> FloatArray:
    """Return the frequencies (k,) in Hz of the table of eigenvalues."""
    table = dat.partition("E I G E N V A L U E   O U T P U T")[2]
    rows = re.findall(r"^\s+\d+\s+\S+\s+\S+\s+([-+.\dE]+)\s+\S+\s*$", table.partition("P A R T")[0], re.MULTILINE)
    return np.array([float(each) for each in rows])


def _deck(result: FemResult) -> Iterator[str]:
    model, case = result.model, result.case
    mesh = model.mesh
    edges, edge, _ = edge_of_half_edges(mesh)
    middles = mesh.n_vertices + edge.reshape(-1, 3)
    places = np.vstack([mesh.vertices_m, mesh.vertices_m[edges].mean(axis=1)])
    yield "** A shell case of trocar fem: SI units; each triangle with nodes in the middle of its straight edges."
    yield "*NODE, NSET=ALL"
    yield from (f"{k}, {_number(x)}, {_number(y)}, {_number(z)}" for k, (x, y, z) in enumerate(places.tolist(), 1))
    kinds, kind = _sections(model)
    for k in range(len(kinds)):
        yield f"*ELEMENT, TYPE=S6, ELSET=WALL{k}"
        for t in np.flatnonzero(kind == k).tolist():
            yield f"{t + 1}, " + ", ".join(str(node + 1) for node in (*mesh.triangles[t], *middles[t]))
    for name, vertices in mesh.vertex_sets.items():
        yield f"*NSET, NSET={_set_name(name)}"
        yield from _rows(np.sort(vertices) + 1)
    for k, (thickness_m, modulus_pa) in enumerate(kinds.tolist()):
        yield f"*MATERIAL, NAME=M{k}"
        yield "*ELASTIC"
        yield f"{_number(modulus_pa)}, {_number(case.material.poisson_ratio)}"
        yield "*DENSITY"
        yield f"{_number(case.material.density_kg_m3)}"
        yield f"*SHELL SECTION, ELSET=WALL{k}, MATERIAL=M{k}"
        yield f"{_number(thickness_m)}"
    if result.static is not None:
        yield from _static_step(result, edges, middles)
    if result.modes is not None:
        yield "*STEP"
        yield "*FREQUENCY"
        yield f"{2 * case.modes + MORE_MODES}"
        yield from _supports(result, edges, is_moved=False)
        yield "*END STEP"


def _static_step(result: FemResult, edges: IntArray, middles: IntArray) -> Iterator[str]:
    yield "*STEP"
    yield "*STATIC"
    yield from _supports(result, edges, is_moved=True)
    load = nodal_load(result, len(edges), middles)
    if load.any():
        yield "*CLOAD"
        for node, dof in np.argwhere(load):
            yield f"{node + 1}, {dof + 1}, {_number(load[node, dof])}"
    yield "*NODE FILE, OUTPUT=2D"
    yield "U"
    yield "*END STEP"


def _number(value: float) -> str:
    """Return a number in the 20 characters that CalculiX reads."""
    return f"{value:.12e}"


def _sections(model: ShellModel) -> tuple[FloatArray, IntArray]:
    """Return the different pairs of thickness and modulus (k, 2), and which each triangle has (m,)."""
    m = model.mesh.n_triangles
    both = np.stack([model.section.per_triangle(name, m) for name in ("thickness_m", "youngs_modulus_pa")], axis=1)
    kinds, kind = np.unique(both, axis=0, return_inverse=True)
    return kinds, kind.reshape(-1).astype(np.int32)


def _supports(result: FemResult, edges: IntArray, *, is_moved: bool) -> Iterator[str]:
    """Yield the held dofs; the middle of an edge is held as both its ends are, at the mean of their displacements."""
    n = result.model.mesh.n_vertices
    held, moved = np.zeros((n, 6), bool), np.zeros((n, 6))
    for k, support in enumerate(result.case.supports):
        vertices = select(result.model.mesh, support.where, f"supports.{k}.where")
        for name in support.dofs:
            dof = DOF_NAMES.index(name)
            held[vertices, dof] = True
            if dof < 3:
                moved[vertices, dof] = support.displacement_m[dof]
    held = np.vstack([held, held[edges].all(axis=1)])
    moved = np.vstack([moved, moved[edges].mean(axis=1)]) * is_moved
    if held.any():
        yield "*BOUNDARY"
        for node, dof in np.argwhere(held):
            yield f"{node + 1}, {dof + 1}, {dof + 1}, {_number(moved[node, dof])}"


def nodal_load(result: FemResult, n_edges: int, middles: IntArray) -> FloatArray:
    """Return the load (n + n_edges, 6) of the case on corners and middles of edges."""
    model, mesh = result.model, result.model.mesh
    load = np.zeros((mesh.n_vertices + n_edges, 6))
    normals = triangle_area_vectors(mesh)
    areas = np.linalg.norm(normals, axis=1)[:, None]
    weight = areas * model.section.per_triangle("thickness_m", mesh.n_triangles)[:, None]
    for k, part in enumerate(result.case.loads):
        if part.where is not None:
            vertices = select(mesh, part.where, f"loads.{k}.where")
            first = 0 if part.force_n is not None else 3
            load[vertices, first : first + 3] += np.array(part.force_n or part.moment_n_m) / len(vertices)
            continue
        if part.pressure_pa is not None:
            whole = part.pressure_pa * normals
        elif part.traction_pa is not None:
            whole = areas * np.array(part.traction_pa)
        else:
            whole = result.case.material.density_kg_m3 * weight * np.array(part.acceleration_m_s2)
        np.add.at(load[:, :3], middles, whole[:, None, :] / 3.0)
    return load


def _set_name(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII).upper()[:79]


def _rows(numbers: IntArray) -> Iterator[str]:
    for first in range(0, len(numbers), _FEW):
        yield ", ".join(map(str, numbers[first : first + _FEW].tolist()))


def compare(result: FemResult, other: Comparison) -> list[tuple[str, float, float, float | None]]:
    """Return what is compared: its name with unit, our number, that of CalculiX, and by what part ours is larger.

    There is no such part of a displacement that is nothing beside the largest.
    """
    rows: list[tuple[str, float, float]] = []
    least_m, largest = 0.0, (0.0, 0.0)
    if result.static is not None and other.displacement_m is not None:
        ours_m, theirs_m = result.static.displacement_m, other.displacement_m
        largest = (_largest(ours_m), _largest(theirs_m))
        least_m = NOTHING * largest[1]
        for name, where in result.case.probes.items():
            vertices = select(result.model.mesh, where, f"probes.{name}")
            for axis in range(3):
                ours, theirs = (float(each[vertices, axis].mean()) for each in (ours_m, theirs_m))
                rows.append((f"{name}, {'xyz'[axis]} m", ours, theirs))
        ours, theirs = (float(np.sqrt((each**2).sum(axis=1).mean())) for each in (ours_m, theirs_m))
        rows.append(("largest displacement m", largest[0], largest[1]))
        rows.append(("root mean square of all displacements m", ours, theirs))
    if result.modes is not None and other.frequency_hz is not None:
        pairs = zip(result.modes.frequency_hz.tolist(), other.frequency_hz.tolist(), strict=False)
        rows += [(f"frequency {k} Hz", *pair) for k, pair in enumerate(pairs, 1)]
    return [(name, ours, theirs, ours / theirs - 1.0 if abs(theirs) > least_m else None) for name, ours, theirs in rows]


def _largest(displacement_m: FloatArray) -> float:
    return float(np.linalg.norm(displacement_m, axis=1).max())


def apart(result: FemResult, other: Comparison) -> float | None:
    """Return the root mean square of the difference of all displacements, as a part of that of ours."""
    if result.static is None or other.displacement_m is None:
        return None
    ours_m = result.static.displacement_m
    return float(np.linalg.norm(ours_m - other.displacement_m) / max(float(np.linalg.norm(ours_m)), 1e-300))
