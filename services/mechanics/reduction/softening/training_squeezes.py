"""Training data of the softening law: pinches, pokes and pulls of the wall in the nonlinear shell model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel, ShellSection, Support
from trocar.services.mechanics.fem.boundary_conditions import DOF_NAMES
from trocar.services.mechanics.fem.nonlinear import (
    CorotationalShell,
    NonlinearLoad,
    PathPoint,
    PathSettings,
    trace_path,
)
from trocar.services.mechanics.fem.section import Orthotropy
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.softening.load_sites import Lumen
from trocar.services.mechanics.surface.mesh import TriangleMesh, unique_edges

SEED = 1
"""Any one, so that each training of a wall draws the same."""
PINCH_DEPTHS, POKE_DEPTHS, PULL_DEPTHS = (0.25, 0.6), (0.15, 0.5), (-0.25, -0.1)
"""Parts of the lumen's width."""
PATCH_RADII = (0.0, 0.35)
"""Parts of the lumen's width."""
PATCH_DEPTH = 0.01
"""Part of the lumen's width: a straight jaw touches only what stands out."""
N_STEPS = 5
"""Equilibria that are kept of each squeeze."""
TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Squeeze:
    """Wall pressed at one place by straight jaws: displacement imposed along one line, at one side or at two that face.

    Attributes:
        node: int. Middle of the patch; the line is its normal.
        depth_m: float. By which the patch moves inward, or two patches towards each other; negative outward.
        radius_m: float. Of the patches, at least a node each, of what stands out furthest.
        is_pinch: bool. Whether two patches move.
    """

    node: int
    depth_m: float
    radius_m: float
    is_pinch: bool


@dataclass(frozen=True, slots=True)
class SqueezedState:
    """One equilibrium: pressed nodes (k,), forces (k, 3) on them in N, and the sum of force times displacement in J."""

    nodes: IntArray
    force_n: FloatArray
    work_j: float


def draw_squeezes(
    recipe: DuctRecipe, lumen: Lumen, candidates: IntArray, n: int, seed: int = SEED, beside: IntArray | None = None
) -> list[Squeeze]:
    """Five of eight are pinches, two pokes inward, one outward; everywhere on the free wall, a third on open rims.

    A rim has wall on one side only and folds in its own way, and it is where instruments are. One of six is on a node
    ``beside`` a support, if there are such.
    """
    random = np.random.default_rng(seed)
    edges, n_triangles = unique_edges(recipe.mesh)
    rim = np.setdiff1d(np.unique(edges[n_triangles == 1]), _held(recipe))
    squeezes = []
    for k in range(n):
        among = candidates if k % 6 != 1 or beside is None or not len(beside) else beside
        node = int(random.choice(rim if k % 3 == 0 and len(rim) else among))
        is_pinch = k % 8 not in (1, 3, 5)
        depths = PINCH_DEPTHS if is_pinch else PULL_DEPTHS if k % 8 == 5 else POKE_DEPTHS
        width = lumen.width_m[node]
        depth, radius = width * random.uniform(*depths), width * random.uniform(*PATCH_RADII)
        squeezes.append(Squeeze(node, depth, radius, is_pinch))
    return squeezes


def follow(recipe: DuctRecipe, lumen: Lumen, squeeze: Squeeze) -> list[SqueezedState]:
    """Equilibria of the full nonlinear shell up to the squeeze's depth, or up to where it cannot be followed.

    The mesh is turned so that the line is the y axis: supports are along global axes.
    Raises ValueError if a support of the recipe holds some axes only.
    """
    if any(set(support.dofs) != set(DOF_NAMES) for support in recipe.supports):
        raise ValueError("squeezes of a wall need supports that hold all axes")
    turn = _frame_with_y(lumen.inward[squeeze.node])
    mesh = _turned_mesh(recipe, turn)
    pressed, imposed = _pressed(mesh, recipe, lumen, squeeze)
    supports = [*recipe.supports, *(Support(patch, ("uy",)) for patch in pressed)]
    model = ShellModel(mesh, _turned(recipe.section, turn), supports, recipe.elements)
    nodes = np.concatenate(pressed)
    states: list[SqueezedState] = []

    def keep(point: PathPoint) -> None:
        force = point.reaction[nodes, :3]
        moved = point.at.position_m[nodes] - mesh.vertices_m[nodes]
        states.append(SqueezedState(nodes, force @ turn, float(np.sum(force * moved))))

    load = NonlinearLoad(np.zeros_like(imposed), 0.0, imposed)
    try:
        trace_path(CorotationalShell(model), load, PathSettings(N_STEPS, tolerance=TOLERANCE), keep)
    except ValueError:
        # A wall that buckles under the jaws has no path further on; what came before is as good as any other.
        if not states:
            raise
    return states


def pressed_nodes(recipe: DuctRecipe, lumen: Lumen, squeeze: Squeeze) -> tuple[IntArray, FloatArray]:
    """Return the nodes (k,) that a squeeze presses, and the direction (k, 3) in which each is moved."""
    mesh = _turned_mesh(recipe, _frame_with_y(lumen.inward[squeeze.node]))
    patches, _ = _pressed(mesh, recipe, lumen, squeeze)
    way = np.repeat((1.0, -1.0)[: len(patches)], [len(patch) for patch in patches])
    return np.concatenate(patches), way[:, None] * lumen.inward[squeeze.node]


def _turned_mesh(recipe: DuctRecipe, turn: FloatArray) -> TriangleMesh:
    return TriangleMesh(recipe.mesh.vertices_m @ turn.T, recipe.mesh.triangles, recipe.mesh.vertex_sets)


def _pressed(
    mesh: TriangleMesh, recipe: DuctRecipe, lumen: Lumen, squeeze: Squeeze
) -> tuple[list[IntArray], FloatArray]:
    """Patches, and the displacements (n, 6) imposed on them."""
    x, imposed = mesh.vertices_m, np.zeros((mesh.n_vertices, 6))
    ways, patches = ((1.0, -1.0) if squeeze.is_pinch else (1.0,)), []
    for way in ways:
        middle = x[squeeze.node]
        if way < 0.0:
            middle = middle + np.array([0.0, lumen.width_m[squeeze.node], 0.0])
        distance = np.linalg.norm(x - middle, axis=1)
        distance[_held(recipe)] = np.inf
        first = int(distance.argmin())
        stands_out = way * (x[:, 1] - x[first, 1]) <= PATCH_DEPTH * lumen.width_m[squeeze.node]
        patch = np.flatnonzero((distance <= max(squeeze.radius_m, distance[first])) & stands_out).astype(np.int32)
        imposed[patch, 1] = way * squeeze.depth_m / len(ways)
        patches.append(patch)
    if len(patches) == 2:
        patches[1] = np.setdiff1d(patches[1], patches[0]).astype(np.int32)
    return patches, imposed


def _held(recipe: DuctRecipe) -> IntArray:
    return np.unique(np.concatenate([support.vertices for support in recipe.supports]))


def _frame_with_y(direction: FloatArray) -> FloatArray:
    """(3, 3) rotation that turns a direction to the y axis."""
    y = direction / np.linalg.norm(direction)
    x = np.cross(y, np.eye(3)[np.abs(y).argmin()])
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)])


def _turned(section: ShellSection, turn: FloatArray) -> ShellSection:
    if section.orthotropy is None:
        return section
    axis: FloatArray = np.asarray(section.orthotropy.axis, np.float64) @ turn.T
    turned: Orthotropy = replace(section.orthotropy, axis=axis)
    return replace(section, orthotropy=turned)
