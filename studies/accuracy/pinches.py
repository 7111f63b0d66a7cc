"""A pinch of the duct's middle, spread over a jaw's width: statics and motion, in full and reduced."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark, ReducedDuct
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_recipe import duct_recipe
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct, scene_mesh
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2
from trocar.studies.accuracy.study import Error
from trocar.studies.full_model import DirectNewmark, rayleigh_damping_ratio

FORCE, WALL, MOTION, FREQUENCY = "force at the tool, pinch", "wall displacement", "motion after a push", "frequency"
JAW_WIDTH_M = 1e-3
"""Standard deviation of the load over the wall: about a jaw's radius."""
PUSH_S, FOLLOWED_S = 20e-3, 80e-3
_POINTS = np.array([(i + 1.0, j + 1.0, 14.0 - i - j) for i in range(15) for j in range(15 - i)]) / 16.0
_POINTS /= _POINTS.sum(axis=1, keepdims=True)
"""Barycentric places in a triangle, evenly spread, at which a load is taken."""
ALPHA_1_S, BETA_S = 20.0, 2e-4
"""Rayleigh damping of the motion: a few per cent of critical where a hand feels it."""


@dataclass(frozen=True, slots=True)
class Pinch:
    """Opposite unit forces on both sides of the middle of a straight duct, spread over nodes.

    Attributes:
        nodes: (k,) int32
        forces_n: (k, 3) float64. 1 N inwards on either side.
    """

    nodes: IntArray
    forces_n: FloatArray

    @classmethod
    def of(cls, mesh: TriangleMesh, duct: DuctScene) -> Pinch:
        """Spread the forces as a bell of pressure, integrated over the triangles: the same load on any mesh."""
        load = np.zeros((mesh.n_vertices, 3))
        corners, areas = mesh.vertices_m[mesh.triangles], triangle_areas_m2(mesh)
        points = np.einsum("ka,mad->mkd", _POINTS, corners)
        for side in (1.0, -1.0):
            away = np.sum((points - (0.5 * duct.length_m, 0.0, side * duct.radius_m)) ** 2, axis=2)
            weight = areas[:, None] * np.exp(-0.5 * away / JAW_WIDTH_M**2) * (away < (4.0 * JAW_WIDTH_M) ** 2)
            np.add.at(load[:, 2], mesh.triangles, -side * (weight @ _POINTS) / weight.sum())
        nodes = np.flatnonzero(load[:, 2]).astype(np.int32)
        return cls(nodes, load[nodes])

    def load_n(self, n_nodes: int) -> FloatArray:
        """Return the forces (n, 3) on all nodes."""
        load = np.zeros((n_nodes, 3))
        load[self.nodes] = self.forces_n
        return load

    def closing_m(self, moved_m: FloatArray) -> float:
        """Return by how much the jaws come closer: what works against the forces; ``moved_m`` is (n, 3)."""
        return float(np.sum(self.forces_n * moved_m[self.nodes]))


def full_model(duct: DuctScene) -> ShellModel:
    """Return the unreduced duct."""
    return duct_recipe(duct, scene_mesh(duct)).model()


def reduced(duct: DuctScene) -> ReducedDuct:
    """Return the duct as a scene has it."""
    return build_scene_duct(SceneModel(duct=duct), cache_directory() / "bases")


def pinched(duct: ReducedDuct, pinch: Pinch) -> FloatArray:
    """Return the static displacement (n, 3) of all nodes under the pinch: modes and residual."""
    basis = duct.basis
    state = ModalState.at_rest(basis.n_modes)
    state.q[:] = np.einsum("nar,na->r", basis.Phi[pinch.nodes], pinch.forces_n) / basis.omega_rad_s**2
    return duct.displacements(state.q, pinch.nodes, pinch.forces_n)


def static_errors(duct: ReducedDuct, pinch: Pinch, closing_m: float, moved_m: FloatArray | None) -> dict[str, Error]:
    """Return the errors of the force that a given closing of the jaws takes, and of the wall's displacement.

    ``closing_m`` and, on the same mesh, ``moved_m`` (n, 3) are the reference's under the same load.
    """
    moved = pinched(duct, pinch)
    errors = {FORCE: Error(100.0 * abs(closing_m / pinch.closing_m(moved) - 1.0), "%")}
    if moved_m is not None:
        apart = np.linalg.norm(moved - moved_m) / np.linalg.norm(moved_m)
        errors[WALL] = Error(100.0 * float(apart), "%")
    return errors


def push_of(time_s: float) -> float:
    """Return the share of the pinch that acts: one half wave of a sine."""
    return math.sin(math.pi * time_s / PUSH_S) if time_s < PUSH_S else 0.0


def full_motion_m(model: ShellModel, pinch: Pinch, dt_s: float, every_s: float) -> FloatArray:
    """Return how far the jaws come closer (k,) in the unreduced model, by Newmark in short steps."""
    direct, load = DirectNewmark(model, dt_s, ALPHA_1_S, BETA_S), pinch.load_n(model.mesh.n_vertices)
    per_sample = round(every_s / dt_s)
    closing = np.empty(round(FOLLOWED_S / every_s))
    for step in range(closing.size * per_sample):
        direct.step(push_of((step + 1) * dt_s) * load)
        if (step + 1) % per_sample == 0:
            closing[step // per_sample] = pinch.closing_m(direct.displacements())
    return closing


def modal_motion_m(duct: ReducedDuct, pinch: Pinch, dt_s: float, every_s: float, *, is_exact: bool) -> FloatArray:
    """Return the same (k,) of a reduced duct: the modes in steps, the residual at once."""
    basis = duct.basis
    damping = rayleigh_damping_ratio(basis.omega_rad_s, ALPHA_1_S, BETA_S)
    integrator = (ExactOscillator if is_exact else Newmark)(basis.omega_rad_s, damping)
    state, rows = ModalState.at_rest(basis.n_modes), np.einsum("nar,na->r", basis.Phi[pinch.nodes], pinch.forces_n)
    left_out = np.zeros_like(pinch.forces_n)
    duct.residual.apply(pinch.nodes, pinch.forces_n, pinch.nodes, left_out)
    residual_m = float(np.sum(pinch.forces_n * left_out))
    per_sample = round(every_s / dt_s)
    closing = np.empty(round(FOLLOWED_S / every_s))
    for step in range(closing.size * per_sample):
        # The exact step holds the force, Newmark takes that at its end.
        acting = push_of((step + 0.5 if is_exact else step + 1.0) * dt_s)
        integrator.predict(state, acting * rows, dt_s)
        if (step + 1) % per_sample == 0:
            closing[step // per_sample] = rows @ state.q + residual_m * push_of((step + 1) * dt_s)
    return closing


def motion_error(closing_m: FloatArray, reference_m: FloatArray) -> Error:
    """Return the root mean square difference over that of the reference."""
    return Error(100.0 * float(np.linalg.norm(closing_m - reference_m) / np.linalg.norm(reference_m)), "%")
