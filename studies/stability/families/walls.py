"""Walls at the ends of what a shell can be: thin and thick, incompressible, meshed with slivers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.fem import ShellModel, ShellSection, clamp, pressure_load
from trocar.services.mechanics.scene import DuctScene
from trocar.services.mechanics.simulation.scene_duct import scene_mesh
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.studies.stability.drive import Driven, Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import beside, threaded, with_duct
from trocar.studies.stability.strokes import stroking

THICKNESS_OVER_RADIUS = 0.002, 0.005, 0.01, 0.03, 0.1, 0.3
POISSON = 0.0, 0.3, 0.45, 0.49, 0.499, 0.4999
SLIVERS = 10, 30, 100
SITUATIONS = {"holding": threaded, "beside": beside}
PRESSURE_PA = 1.0


def thickness_cases(draw: Draw) -> Iterator[Case]:
    """A tube under pressure, and strokes."""
    for ratio in THICKNESS_OVER_RADIUS if draw.is_long else (0.002, 0.3):
        radius_m = threaded().scene.duct.radius_m
        yield from _of_wall(draw, f"t/R {ratio:g}", {"thickness_m": ratio * radius_m}, 1)


def poisson_cases(draw: Draw) -> Iterator[Case]:
    """The same for every Poisson's ratio, which the answer of the tube does not depend on."""
    for ratio in POISSON if draw.is_long else (0.4999,):
        yield from _of_wall(draw, f"Poisson {ratio:g}", {"poisson_ratio": ratio}, 1)


def sliver_cases(draw: Draw) -> Iterator[Case]:
    """The same with a fifth of the vertices moved along the tube until triangles are slivers."""
    for ratio in SLIVERS if draw.is_long else (100,):
        yield from _of_wall(draw, f"slivers 1:{ratio}", {}, ratio)


def _of_wall(draw: Draw, what: str, changes: dict[str, float], slivers: int) -> Iterator[Case]:
    yield Case(f"{what}, pressure", partial(_tube, draw, what, changes, slivers))
    for situation in SITUATIONS if draw.is_long else ():
        for k in range(3):
            name = f"{what}, {situation}, number {k}"
            yield played(name, partial(_stroke, draw, name, situation, changes, slivers))


def _tube(draw: Draw, what: str, changes: dict[str, float], slivers: int) -> Driven:
    """The widening of a tube far from its clamp, p R^2 / (E t), on the mid-surface, whatever Poisson's ratio is."""
    duct = replace(threaded().scene.duct, n_around=24, n_along=32, **changes)  # type: ignore[arg-type]
    mesh = _mesh(duct, slivers, draw.random(f"slivers {what}"))
    section = ShellSection(duct.thickness_m, duct.youngs_modulus_pa, duct.poisson_ratio, duct.density_kg_m3)
    solution = ShellModel(mesh, section, (clamp(mesh),)).solve_static(pressure_load(mesh, PRESSURE_PA))
    radial = np.column_stack([np.zeros(mesh.n_vertices), mesh.vertices_m[:, 1:] / duct.radius_m])
    middle = np.abs(mesh.vertices_m[:, 0] - 0.6 * duct.length_m) < 0.15 * duct.length_m
    widened_m = float(np.mean(np.sum(radial * solution.displacement_m, axis=1)[middle]))
    # The inscribed polygon bears the pressure on its chords: cos(pi/n) of the circle's radius.
    exact_m = PRESSURE_PA * duct.radius_m**2 / (duct.youngs_modulus_pa * duct.thickness_m)
    figures = {"residual": solution.residual, "reference": abs(widened_m / exact_m - 1.0)}
    return Driven(figures, repr(widened_m), 1)


def _mesh(duct: DuctScene, slivers: int, random: np.random.Generator) -> TriangleMesh:
    """Move a fifth of the inner rings' vertices towards the next ring, to 1/``slivers`` of the distance."""
    mesh = scene_mesh(duct)
    vertices = mesh.vertices_m.copy().reshape(duct.n_along + 1, duct.n_around, 3)
    if slivers > 1:
        moved = random.random((duct.n_along + 1, duct.n_around)) < 0.2
        moved[[0, -2, -1]] = False
        moved[2::2] = False  # not two on one line: the second would pass the first
        row_m = duct.length_m / duct.n_along
        vertices[..., 0] += np.where(moved, row_m * (1.0 - 1.0 / slivers), 0.0)
    return TriangleMesh(vertices.reshape(-1, 3), mesh.triangles, mesh.vertex_sets)


def _stroke(draw: Draw, name: str, situation: str, changes: dict[str, float], slivers: int) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"walls {name}")
    scene = with_duct(start.scene, **changes)
    mesh = _mesh(scene.duct, slivers, random) if slivers > 1 else None
    return Play(scene=scene, hands=stroking(start, random, 300), mesh=mesh)
