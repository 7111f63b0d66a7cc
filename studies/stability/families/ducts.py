"""Ducts other than one: conical, curved, slit, cut obliquely, meshed coarser and finer, and bulging like anatomy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import DuctScene
from trocar.services.mechanics.simulation.scene_duct import scene_mesh
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import least_jerk
from trocar.studies.stability.situations import GRIP_M, LEAD_STEPS, STEADY_M, threaded, with_catheter, with_duct
from trocar.studies.stability.strokes import stroking

Shape = Callable[[np.random.Generator], dict[str, float | int]]
COUNT = 8
BULGES = 3

SHAPES: dict[str, Shape] = {
    "conical": lambda random: {"taper": random.uniform(-0.3, 0.4)},
    "curved": lambda random: {"curvature_1_m": random.uniform(3.0, 12.0)},
    "slit": lambda random: {
        "slit_length_m": random.uniform(4e-3, 15e-3),
        "slit_width_m": random.uniform(0.5e-3, 3e-3),
    },
    "oblique": lambda random: {"cut_angle_rad": random.choice([-1.0, 1.0]) * random.uniform(0.2, 0.7)},
    "coarser": lambda _: {"n_around": 12, "n_along": 14},
    "finer": lambda _: {"n_around": 36, "n_along": 44},
    "bulging": lambda random: {"curvature_1_m": random.uniform(0.0, 10.0)},
}


def cases(draw: Draw) -> Iterator[Case]:
    """Strokes, and in every second case a jerk, in ducts of each kind, the catheter on the mouth's axis."""
    for shape in SHAPES if draw.is_long else ("curved",):
        for k in range(COUNT if draw.is_long else 1):
            name = f"{shape}, number {k}"
            yield played(name, partial(_play, draw, name, shape, jerks=k % 2 == 1))


def _play(draw: Draw, name: str, shape: str, *, jerks: bool) -> Play:
    start, random = threaded(), draw.random(f"ducts {name}")
    scene = with_duct(start.scene, **SHAPES[shape](random))
    mesh = _bulging(scene.duct, random) if shape == "bulging" else scene_mesh(scene.duct)
    scene = with_catheter(scene, before_mouth_m=3e-3)
    mouth, steady_m = mouth_opening(mesh), on_axis(scene.duct, STEADY_M[0])
    hands = stroking(replace(start, scene=scene), random, 400)
    grip_m = mouth.centre_m - (GRIP_M[0] - start.scene.duct.length_m) * mouth.inward
    for tool, shift_m in enumerate((grip_m - GRIP_M, steady_m - STEADY_M)):
        hands = hands.moved(tool, shift_m[None], 0)
    hands = hands.moved(0, least_jerk(random.uniform(10e-3, 18e-3), mouth.inward, 0.2), LEAD_STEPS)
    if jerks:
        direction = random.normal(size=3)
        way = least_jerk(20e-3, direction / np.linalg.norm(direction), 0.5)
        hands = hands.moved(int(random.integers(2)), way, LEAD_STEPS + 200)
    return Play(scene=scene, hands=hands, mesh=mesh)


def on_axis(duct: DuctScene, along_m: float) -> FloatArray:
    """Return the point of the axis so far from the clamped end."""
    turn = duct.curvature_1_m * along_m
    return along_m * np.array([np.sinc(turn / np.pi), 0.5 * turn * np.sinc(0.5 * turn / np.pi) ** 2, 0.0])


def _bulging(duct: DuctScene, random: np.random.Generator) -> TriangleMesh:
    """The duct with bumps and dents, as a scanned vessel has, of up to a quarter of its radius."""
    mesh = scene_mesh(duct)
    at_m, middle_m = mesh.vertices_m, duct.length_m * random.uniform(0.2, 0.8, BULGES)
    outwards = at_m.reshape(duct.n_along + 1, duct.n_around, 3)
    outwards = (outwards - outwards.mean(axis=1, keepdims=True)).reshape(-1, 3)
    towards = random.normal(size=(BULGES, 3))
    along_m = np.repeat(np.linspace(0.0, duct.length_m, duct.n_along + 1), duct.n_around)
    part = np.zeros(len(at_m))
    for bulge in range(BULGES):
        facing = outwards @ towards[bulge] / np.linalg.norm(towards[bulge]) / duct.radius_m
        near = np.exp(-(((along_m - middle_m[bulge]) / duct.radius_m) ** 2))
        part += random.uniform(-0.25, 0.25) * near * np.maximum(facing, 0.0)
    return TriangleMesh(at_m + part[:, None] * outwards, mesh.triangles, mesh.vertex_sets)
